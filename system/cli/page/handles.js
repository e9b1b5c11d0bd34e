// The tips of the simulated robot, which are dragged in its picture, or moved by keys and fields.

import { element } from './element.js';

const MM = 1e-3, FAR = 10;
// What a key moves as it is seen: to the right, up, and away.
const KEYS = {
  ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, 1, 0], ArrowDown: [0, -1, 0],
  PageUp: [0, 0, 1], PageDown: [0, 0, -1],
};

export class Handles {
  constructor(nodes, figure, pose) {
    Object.assign(this, { nodes, figure, pose, all: [], name: null, target: null });
    figure.chosen = name => this.choose(name);
    figure.dragged = (name, to) => this.bring(name, to);
    nodes.point.forEach((field, axis) => {
      field.oninput = () => { field.isWritten = true; };
      field.onchange = () => {
        field.isWritten = false;
        const to = [...this.place(this.name)];
        if (Number.isFinite(field.valueAsNumber)) to[axis] = field.valueAsNumber * MM;
        this.bring(this.name, to);
      };
    });
  }

  describe(names) {
    this.buttons = names.map(name => {
      const button = element('button', { type: 'button', textContent: name });
      button.onclick = () => this.choose(name);
      button.onkeydown = event => this.key(event, name);
      return button;
    });
    this.nodes.list.replaceChildren(...this.buttons);
    this.choose(names[0]);
  }

  choose(name) {
    if (this.name !== name) this.target = null;
    this.name = name;
    for (const button of this.buttons) button.setAttribute('aria-pressed', button.textContent === name);
    this.show(this.all);
  }

  key(event, name) {
    const way = KEYS[event.key];
    if (!way || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.choose(name);
    const by = way.map(it => it * MM * (event.shiftKey ? FAR : 1));
    // What is on its way counts, but not what was out of reach.
    const from = this.pose.isBusy && this.target ? this.target : this.place(name);
    this.bring(name, this.figure.moved(from, ...by));
  }

  place(name) { return this.all.find(handle => handle.name === name)?.at ?? [0, 0, 0]; }

  bring(name, to) {
    this.target = to;
    this.pose.bring(name, to);
  }

  // Shows where the tips are.
  show(all) {
    this.all = all;
    this.figure.handles = all.map(handle => ({ ...handle, isChosen: handle.name === this.name }));
    this.figure.changed();
    const at = this.place(this.name);
    this.nodes.point.forEach((field, axis) => {
      const text = (at[axis] / MM).toFixed(1);
      if (!field.isWritten && field.value !== text) field.value = text;
    });
  }
}
