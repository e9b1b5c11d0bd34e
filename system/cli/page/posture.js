// The joints of the simulated robot: a slider and a field for each.

import { element, short, words } from './element.js';

// The greatest number of joints that are shown, and the step of a slider, rad or m.
const SHOWN = 24, STEP = 0.01;

export class Posture {
  // `move` is called with the number of a joint and its position.
  constructor(nodes, move) {
    Object.assign(this, { nodes, move, joints: [], positions: [], rows: [] });
    nodes.filter.addEventListener('input', () => this.build());
  }

  describe(joints) {
    this.joints = joints;
    this.build();
  }

  build() {
    const { list, filter, more } = this.nodes;
    const isFound = words(filter.value);
    const found = this.joints.map((joint, number) => ({ joint, number })).filter(({ joint }) => isFound(joint.name));
    this.rows = found.slice(0, SHOWN).map(({ joint, number }) => this.row(joint, number));
    list.replaceChildren(...this.rows.map(row => row.node));
    const left = found.length - SHOWN;
    more.textContent = !found.length ? 'There is no such joint.'
      : left > 0 ? `${left} more: write a part of a name into the filter to see them.` : '';
    this.show(this.positions);
  }

  row({ name, limits: [low, high] }, number) {
    const id = `sim-joint-${number}`;
    const range = element('small', { textContent: `${short(low)} to ${short(high)} rad` });
    const label = element('label', { htmlFor: id }, `${name} `, range);
    const slider = element('input', { type: 'range', min: low, max: high, step: STEP });
    slider.setAttribute('aria-label', name);
    const field = element('input', { type: 'number', id, step: STEP });
    slider.oninput = () => this.move(number, slider.valueAsNumber);
    field.oninput = () => { field.isWritten = true; };
    field.onchange = () => {
      field.isWritten = false;
      if (Number.isFinite(field.valueAsNumber)) this.move(number, field.valueAsNumber);
      else this.show(this.positions);
    };
    return { node: element('div', { className: 'parameter' }, label, slider, field), number, slider, field };
  }

  // Shows positions, but not over what somebody writes.
  show(positions) {
    this.positions = positions;
    for (const { number, slider, field } of this.rows) {
      const position = positions[number];
      if (position === undefined) continue;
      if (slider !== document.activeElement || Math.abs(slider.valueAsNumber - position) > STEP / 2) slider.value = position;
      const text = String(short(position));
      if (!field.isWritten && field.value !== text) field.value = text;
    }
  }
}
