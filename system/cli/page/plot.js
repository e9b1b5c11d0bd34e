// Plots of chosen variables over time: a pane for each unit.

import { DASHES, chart, colors, key } from './chart.js';
import { element } from './element.js';

// The seconds that are shown, and the samples that are kept of a curve.
const SPAN = 10, SAMPLES = 400;

export class Plots {
  constructor(panes, changed) {
    Object.assign(this, { panes, changed, curves: [] });
    this.recolor();
  }

  recolor() { this.colors = colors(); }

  // Adds the curve of a variable; returns the reason for which it cannot be.
  add(variable) {
    if (this.curves.some(curve => curve.variable === variable)) return 'This variable is shown already.';
    const used = new Set(this.curves.map(curve => curve.style));
    const style = DASHES.findIndex((_, style) => !used.has(style));
    if (style < 0) return `There are ${DASHES.length} curves already; remove one first.`;
    this.curves.push({ variable, style, times: [], values: [] });
    this.build();
    return '';
  }

  // Takes the variables of a new connection.
  renew(variables) {
    for (const curve of this.curves) {
      curve.variable = variables.find(it => it.label === curve.variable.label) ?? curve.variable;
    }
  }

  names() { return this.curves.map(curve => curve.variable.label); }

  build() {
    const units = [...new Set(this.curves.map(curve => curve.variable.unit))];
    this.shown = units.map(unit => {
      const curves = this.curves.filter(curve => curve.variable.unit === unit);
      const canvas = element('canvas');
      canvas.setAttribute('role', 'img');
      const names = curves.map(curve => curve.variable.label).join(', ');
      canvas.setAttribute('aria-label', `${names} over the last ${SPAN} s; the present values stand below.`);
      const items = curves.map(curve => {
        curve.key = element('canvas');
        curve.key.setAttribute('aria-hidden', 'true');
        curve.output = element('span');
        const label = curve.variable.label;
        const remove = element('button', { type: 'button', textContent: '×', onclick: () => this.remove(curve) });
        remove.setAttribute('aria-label', `Remove ${label}`);
        return element('li', {}, curve.key, label, curve.output, remove);
      });
      const list = element('ul', { className: 'curves' }, ...items);
      const title = element('h3', { textContent: unit || 'without unit' });
      return { canvas, curves, node: element('div', { className: 'pane' }, title, canvas, list) };
    });
    this.panes.replaceChildren(...this.shown.map(pane => pane.node));
    this.changed();
  }

  remove(curve) {
    this.curves = this.curves.filter(it => it !== curve);
    this.build();
    this.removed?.();
  }

  // Takes the newest values.
  sample() {
    for (const { variable, times, values } of this.curves) {
      const at = variable.rows.at;
      if (at === undefined || at === times.at(-1)) continue;
      // Time that goes back begins anew.
      if (at < times.at(-1)) times.length = values.length = 0;
      times.push(at);
      values.push(Number(variable.value()));
      if (times.length > SAMPLES) [times, values].forEach(all => all.shift());
    }
  }

  draw() {
    for (const pane of this.shown ?? []) this.pane(pane);
  }

  pane({ canvas, curves }) {
    const last = Math.max(...curves.map(curve => curve.times.at(-1) ?? -Infinity));
    chart(canvas, this.colors, { curves, span: [last - SPAN, last], ends: [`−${SPAN} s`, 'now'] });
    for (const curve of curves) {
      curve.output.textContent = curve.variable.text(curve.variable.value());
      key(curve.key, this.colors, curve.style);
    }
  }
}
