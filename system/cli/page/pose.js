// The posture that is composed: what is wished for is computed by the server, one call at a time.

import { Latest } from './link.js';

export class Pose {
  // `took` gets each answer, and `failed` each error.
  constructor(link, took, failed) {
    Object.assign(this, { positions: [], moved: new Map(), drag: null });
    this.calls = new Latest(link, '/sim/pose', (answer, isOld) => {
      // What was moved meanwhile stays moved.
      this.positions = answer.positions.map((position, joint) => this.moved.get(joint) ?? position);
      took(answer, isOld);
    }, failed);
  }

  get isBusy() { return this.calls.isBusy; }

  // Takes a whole posture.
  take(positions) {
    this.positions = [...positions];
    this.moved = new Map(positions.map((position, joint) => [joint, position]));
    this.drag = null;
    this.ask();
  }

  // Moves a joint.
  move(joint, position) {
    this.positions[joint] = position;
    this.moved.set(joint, position);
    this.drag = null;
    this.ask();
  }

  // Brings a frame to a point, or near to it.
  bring(frame, to) {
    this.drag = { frame, to };
    this.ask();
  }

  ask() {
    this.calls.ask(() => {
      const { positions, drag } = this;
      [this.moved, this.drag] = [new Map(), null];
      return drag ? { positions, drag } : { positions };
    });
  }
}
