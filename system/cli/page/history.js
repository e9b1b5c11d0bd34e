// What was composed, with undo and redo, kept in the browser.

// The greatest number of former states, and of the characters of all.
const STATES = 100, CHARACTERS = 1_000_000;
// The time without a change after which a change is a state of its own, ms.
const QUIET_MS = 400;

export class History {
  // `present` returns the present state, whose JSON tells states apart; `changed` is called when there are others.
  constructor(present, changed) {
    Object.assign(this, { present, changed, past: [], future: [], state: null, key: null, timer: null });
    addEventListener('pagehide', () => this.commit());
  }

  // Returns the last state that was kept under a name, if there is any.
  open(name) {
    this.key = `condor.simulator.${name}`;
    try {
      const kept = JSON.parse(localStorage.getItem(this.key));
      [this.past, this.state, this.future] = [kept.past, kept.state, kept.future];
      return JSON.parse(this.state);
    } catch {
      [this.past, this.state, this.future] = [[], null, []];
      return null;
    }
  }

  // Says that something changes.
  note() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.commit(), QUIET_MS);
  }

  // Makes the present state one to which undo returns.
  commit() {
    clearTimeout(this.timer);
    if (this.key === null) return;
    const state = JSON.stringify(this.present());
    if (state === this.state) return;
    if (this.state !== null) this.past.push(this.state);
    [this.state, this.future] = [state, []];
    this.keep();
  }

  keep() {
    let size = this.past.reduce((sum, state) => sum + state.length, 0);
    while (this.past.length > STATES || (size > CHARACTERS && this.past.length)) size -= this.past.shift().length;
    try {
      localStorage.setItem(this.key, JSON.stringify({ past: this.past, state: this.state, future: this.future }));
    } catch {
      // Without room, or without leave, a reload begins anew.
    }
    this.changed();
  }

  undo() {
    this.commit();
    return this.go(this.past, this.future);
  }

  redo() {
    this.commit();
    return this.go(this.future, this.past);
  }

  go(from, to) {
    if (!from.length) return null;
    to.push(this.state);
    this.state = from.pop();
    this.keep();
    return JSON.parse(this.state);
  }
}
