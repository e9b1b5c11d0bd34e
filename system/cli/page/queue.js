// The queue of the running robot: a motion is enqueued, and what becomes of it is told.

import { say } from './element.js';

// The time between two looks, ms.
const PAUSE_MS = 300;
const STATES = {
  accepted: 'waits for its turn', started: 'runs', done: 'is done', aborted: 'was broken off', lost: 'is lost', refused: 'is refused',
};

export class Queue {
  // `text` returns the present text.
  constructor(link, { button, control, said }, text) {
    Object.assign(this, { link, button, said, id: null });
    button.onclick = async () => {
      button.disabled = true;
      this.tell('The motion is sent …');
      try {
        const { id } = await link.call('/sim/enqueue', { text: text(), control: control.checked });
        this.id = id;
      } catch (error) {
        this.tell(error.isClosed ? 'The connection has closed: nobody knows whether the motion was enqueued.' : error.message, true);
      }
      button.disabled = !this.maySet;
      this.look();
    };
  }

  // Says whether somebody may enqueue.
  allow(maySet) {
    this.maySet = maySet;
    this.button.disabled = !maySet;
    this.look();
  }

  // Looks what has become of the motion until it has ended.
  async look() {
    clearTimeout(this.timer);
    const { id } = this;
    if (id === null) return;
    try {
      const { state, reason, progress, isFinal } = await this.link.call('/sim/outcome', { id });
      if (id !== this.id) return;
      const part = progress === null || isFinal ? '' : `, ${(100 * progress).toFixed(0)} %`;
      this.tell(`The motion ${STATES[state] ?? `is ${state}`}${part}${reason ? `: ${reason}` : ''}.`, isFinal && state !== 'done');
      if (isFinal) this.id = null;
      else this.timer = setTimeout(() => this.look(), PAUSE_MS);
    } catch (error) {
      // It goes on with the next connection.
      if (error.isClosed) return;
      this.id = null;
      this.tell(error.message, true);
    }
  }

  tell(text, isBad = false) {
    this.said.className = isBad ? 'bad' : '';
    say(this.said, text);
  }
}
