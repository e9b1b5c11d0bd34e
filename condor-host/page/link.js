// The connection to the server: the Foxglove websocket protocol, as far as this page needs it.

// The bytes of a frame before the message, and of the message before its fields.
const FRAME = 13, HEADER = 4, HEAD = 24;

const KINDS = {
  bool: [1, (view, at) => view.getUint8(at) !== 0],
  int8: [1, (view, at) => view.getInt8(at)],
  uint8: [1, (view, at) => view.getUint8(at)],
  int16: [2, (view, at) => view.getInt16(at, true)],
  uint16: [2, (view, at) => view.getUint16(at, true)],
  int32: [4, (view, at) => view.getInt32(at, true)],
  uint32: [4, (view, at) => view.getUint32(at, true)],
  int64: [8, (view, at) => Number(view.getBigInt64(at, true))],
  uint64: [8, (view, at) => Number(view.getBigUint64(at, true))],
  float32: [4, (view, at) => view.getFloat32(at, true)],
  float64: [8, (view, at) => view.getFloat64(at, true)],
};

// The rows of one loop or cell: its variables, and the newest row.
class Rows {
  constructor(topic, schema) {
    this.topic = topic;
    this.view = null;
    this.variables = [];
    let labels = [], at = HEAD;
    for (const line of schema.split('\n').slice(3)) {
      const [, kind, name, comment] = line.match(/^(\w+) (\S+) # (.*)$/) ?? [];
      if (!(kind in KINDS)) continue;
      if (name.includes('=')) {
        labels.push(comment);
        continue;
      }
      const [size, read] = KINDS[kind];
      at = Math.ceil(at / size) * size;
      const [own, unit, about] = comment.split('\t');
      const place = at;
      const texts = labels;
      this.variables.push({
        name: own, unit, about, kind, rows: this,
        value: () => this.view && read(this.view, place),
        text(value) { return texts[value] ?? brief(value, kind); },
      });
      at += size;
      labels = [];
    }
    this.bytes = at;
  }

  take(view, at) {
    if (view.byteLength < HEADER + this.bytes) return;
    [this.view, this.at] = [new DataView(view.buffer, view.byteOffset + HEADER), at];
  }
}

function brief(value, kind) {
  if (value === null) return '–';
  if (!kind.startsWith('float')) return String(value);
  if (!Number.isFinite(value)) return 'none';
  const size = Math.abs(value);
  return size === 0 || (size >= 1e-3 && size < 1e6) ? value.toFixed(size < 10 ? 4 : 2) : value.toExponential(3);
}

// Reads texts one after the other.
class Texts {
  constructor(view, at) { [this.view, this.at] = [view, at]; }

  next() {
    this.at = Math.ceil((this.at - HEADER) / 4) * 4 + HEADER;
    const length = this.view.getUint32(this.at, true);
    const bytes = new Uint8Array(this.view.buffer, this.view.byteOffset + this.at + 4, length - 1);
    this.at += 4 + length;
    return new TextDecoder().decode(bytes);
  }
}

// Connects, and calls `on` for what comes: rows, scene, parameters (what they are), values (of them), event,
// status, news (some row has come), closed (and whether it was connected before). Returns how to send.
export function connect({ hz, token }, on) {
  const query = new URLSearchParams(token ? { hz, token } : { hz });
  const socket = new WebSocket(`ws://${location.host}/?${query}`, ['foxglove.sdk.v1']);
  socket.binaryType = 'arraybuffer';
  const takers = [];
  const send = message => socket.send(JSON.stringify(message));

  function advertise(channels) {
    const all = [], subscriptions = [];
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
          send({ op: 'subscribeParameterUpdates', parameterNames: [] });
        };
      } else if (topic === '/events') {
        takers[id] = (view, at) => {
          const texts = new Texts(view, HEADER + 9);
          on.event({ at, level: view.getUint8(HEADER + 8), source: texts.next(), text: texts.next() });
        };
      } else continue;
      subscriptions.push({ id, channelId: id });
    }
    on.rows(all);
    send({ op: 'subscribe', subscriptions });
  }

  socket.onmessage = ({ data }) => {
    if (typeof data === 'string') {
      const message = JSON.parse(data);
      if (message.op === 'serverInfo') on.info(message);
      if (message.op === 'advertise') advertise(message.channels);
      if (message.op === 'parameterValues') on.values(message.parameters, message.id);
      if (message.op === 'status') on.status(message);
      return;
    }
    const frame = new DataView(data);
    if (frame.getUint8(0) !== 1) return;
    const at = Number(frame.getBigUint64(5, true)) / 1e9;
    takers[frame.getUint32(1, true)]?.(new DataView(data, FRAME), at);
  };
  let wasOpen = false;
  socket.onopen = () => { wasOpen = true; };
  socket.onclose = () => on.closed(wasOpen);
  return {
    set: (name, value) => send({ op: 'setParameters', parameters: [{ name, value }], id: name }),
  };
}
