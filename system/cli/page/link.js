// The connection to the server: the Foxglove websocket protocol, as far as this page needs it. It is made anew
// whenever it has closed.

import { HEADER, Rows, Texts } from './rows.js';

// The bytes of a frame of a message before the message.
const FRAME = 13;
// The kinds of binary frames: a message, and the call of a service and its answer.
const MESSAGE = 1, CALL = 2, ANSWER = 3;
const ENCODING = new TextEncoder().encode('json');
// The pauses before the connection is made anew.
const FIRST_MS = 500, LONGEST_MS = 10_000;

export class Link {
  // Calls `on` for what comes: info, rows, scene, parameters (what they are), values (of them), event, status, news
  // (some row has come), services (they can be called), closed (why), refused (why the token is).
  constructor({ hz, token }, on) {
    Object.assign(this, { hz, token, on, pause: FIRST_MS, calls: new Map(), called: 0 });
    this.open();
  }

  // Connects, with the present token.
  open() {
    clearTimeout(this.again);
    const old = this.socket;
    this.socket = new WebSocket(`ws://${location.host}/?${this.query()}`, ['foxglove.sdk.v1']);
    old?.close();
    const socket = this.socket;
    socket.binaryType = 'arraybuffer';
    this.services = new Map();
    this.takers = [];
    // The rows and topics of all channels, of which some may come later.
    this.all = [];
    this.topics = new Set();
    let wasOpen = false;
    socket.onopen = () => {
      wasOpen = true;
      this.pause = FIRST_MS;
    };
    socket.onmessage = ({ data }) => {
      if (socket !== this.socket) return;
      if (typeof data === 'string') this.text(JSON.parse(data));
      else this.frame(data);
    };
    socket.onclose = () => {
      if (socket === this.socket) this.closed(wasOpen);
    };
  }

  query() {
    const { hz, token } = this;
    return new URLSearchParams(token ? { hz, token } : { hz });
  }

  async closed(wasOpen) {
    this.services.clear();
    const error = new Error('The connection has closed.');
    error.isClosed = true;
    for (const { fail } of this.calls.values()) fail(error);
    this.calls.clear();
    const reason = wasOpen ? '' : await this.refusal();
    if (reason && this.token) {
      this.token = null;
      this.on.refused(reason);
      this.open();
      return;
    }
    this.on.closed(reason);
    this.again = setTimeout(() => this.open(), this.pause);
    this.pause = Math.min(2 * this.pause, LONGEST_MS);
  }

  // Returns the reason for which the server refuses this page; none if it does not, or there is no server.
  async refusal() {
    try {
      const answer = await fetch(`icon.svg?${this.query()}`);
      return answer.ok ? '' : (await answer.text()).trim();
    } catch {
      return '';
    }
  }

  text(message) {
    const { on } = this;
    if (message.op === 'serverInfo') on.info(message);
    if (message.op === 'advertise') this.advertise(message.channels);
    if (message.op === 'parameterValues') on.values(message.parameters, message.id);
    if (message.op === 'status') on.status(message);
    if (message.op === 'advertiseServices') {
      for (const { id, name } of message.services) this.services.set(name, id);
      on.services();
    }
    if (message.op === 'serviceCallFailure') this.ended(message.callId, call => call.fail(new Error(message.message)));
  }

  frame(data) {
    const frame = new DataView(data);
    const kind = frame.getUint8(0);
    if (kind === MESSAGE) {
      const at = Number(frame.getBigUint64(5, true)) / 1e9;
      this.takers[frame.getUint32(1, true)]?.(new DataView(data, FRAME), at);
    } else if (kind === ANSWER) {
      const payload = new Uint8Array(data, 13 + frame.getUint32(9, true));
      this.ended(frame.getUint32(5, true), call => call.done(JSON.parse(new TextDecoder().decode(payload))));
    }
  }

  advertise(channels) {
    const { on, takers, all, topics } = this;
    const subscriptions = [];
    for (const { id, topic, schema, schemaName } of channels) {
      if (schemaName.startsWith('condor_rows/')) {
        const rows = new Rows(topic, schema);
        all.push(rows);
        takers[id] = (view, at) => { rows.take(view, at); on.news(); };
      } else if (topic === '/scene') {
        takers[id] = view => on.scene(JSON.parse(new Texts(view, HEADER).next()));
      } else if (topic === '/parameters') {
        takers[id] = view => {
          on.parameters(JSON.parse(new Texts(view, HEADER).next()));
          this.send({ op: 'subscribeParameterUpdates', parameterNames: [] });
        };
      } else if (topic === '/events') {
        takers[id] = (view, at) => {
          const texts = new Texts(view, HEADER + 9);
          on.event({ at, level: view.getUint8(HEADER + 8), source: texts.next(), text: texts.next() });
        };
      } else continue;
      topics.add(topic);
      subscriptions.push({ id, channelId: id });
    }
    on.rows(all, topics);
    this.send({ op: 'subscribe', subscriptions });
  }

  send(message) { this.socket.send(JSON.stringify(message)); }

  // Sets a parameter.
  set(name, value) { this.send({ op: 'setParameters', parameters: [{ name, value }], id: name }); }

  offers(service) { return this.services.has(service); }

  // Calls a service; returns its answer.
  call(service, request) {
    return new Promise((done, fail) => {
      const id = this.services.get(service);
      if (id === undefined) {
        const error = new Error(`The server does not offer ${service}.`);
        error.isClosed = this.socket.readyState !== WebSocket.OPEN;
        fail(error);
        return;
      }
      const payload = new TextEncoder().encode(JSON.stringify(request));
      const frame = new Uint8Array(13 + ENCODING.length + payload.length);
      const view = new DataView(frame.buffer);
      this.called += 1;
      view.setUint8(0, CALL);
      view.setUint32(1, id, true);
      view.setUint32(5, this.called, true);
      view.setUint32(9, ENCODING.length, true);
      frame.set(ENCODING, 13);
      frame.set(payload, 13 + ENCODING.length);
      this.calls.set(this.called, { done, fail });
      this.socket.send(frame);
    });
  }

  ended(id, end) {
    const call = this.calls.get(id);
    this.calls.delete(id);
    if (call) end(call);
  }
}

// Calls a service one call at a time: of what is asked for meanwhile, only the newest is called next.
export class Latest {
  // `took` gets an answer, and `failed` an error.
  constructor(link, service, took, failed) {
    Object.assign(this, { link, service, took, failed, next: null, isBusy: false });
  }

  // `request` returns the request when its turn has come.
  async ask(request) {
    this.next = request;
    if (this.isBusy) return;
    this.isBusy = true;
    while (this.next) {
      const now = this.next;
      this.next = null;
      try {
        const answer = await this.link.call(this.service, now());
        this.took(answer, Boolean(this.next));
      } catch (error) {
        this.failed(error);
      }
    }
    this.isBusy = false;
  }
}
