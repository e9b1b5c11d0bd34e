// Plots of chosen variables over time: a pane for each unit.

import { color, element, fitted } from './element.js';

const CURVES = 6;
// The seconds that are shown, and the samples that are kept of a curve.
const SPAN = 10, SAMPLES = 400;
// Curves differ by their dashes, too.
const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [5, 5], [14, 4]];

export class Plots {
  constructor(panes, changed) {
    Object.assign(this, { panes, changed, curves: [] });
    this.recolor();
  }

  recolor() {
    this.colors = DASHES.map((_, style) => color(`curve-${style}`));
    this.edge = color('edge');
    this.quiet = color('quiet');
  }

  // Adds the curve of a variable; returns the reason for which it cannot be.
  add(variable) {
    if (this.curves.some(curve => curve.variable === variable)) return 'This variable is shown already.';
    const used = new Set(this.curves.map(curve => curve.style));
    const style = DASHES.findIndex((_, style) => !used.has(style));
    if (style < 0) return `There are ${CURVES} curves already; remove one first.`;
    this.curves.push({ variable, style, times: [], values: [] });
    this.build();
    return '';
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
    const { context, width, height } = fitted(canvas);
    const last = Math.max(...curves.map(curve => curve.times.at(-1) ?? -Infinity));
    const all = curves.flatMap(curve => curve.values).filter(Number.isFinite);
    let [low, high] = [Math.min(...all), Math.max(...all)];
    if (!all.length) [low, high] = [0, 1];
    const room = (high - low) * 0.08 || Math.abs(high) * 0.05 || 0.5;
    [low, high] = [low - room, high + room];
    const left = 56, bottom = height - 20;
    const x = time => width - (last - time) / SPAN * (width - left);
    const y = value => bottom - (value - low) / (high - low) * (bottom - 6);
    // As many digits as tell the lines apart.
    const digits = Math.min(Math.max(1 - Math.floor(Math.log10(high - low)), 0), 9);
    context.font = '12px system-ui, sans-serif';
    context.fillStyle = this.quiet;
    context.strokeStyle = this.edge;
    context.lineWidth = 1;
    context.setLineDash([]);
    for (const part of [0, 0.5, 1]) {
      const value = low + (high - low) * part, at = Math.round(y(value)) + 0.5;
      context.beginPath();
      context.moveTo(left, at);
      context.lineTo(width, at);
      context.stroke();
      context.textAlign = 'right';
      context.fillText(Math.abs(value) < 1e6 ? value.toFixed(digits) : value.toExponential(2), left - 8, at + (part === 1 ? 8 : part ? 4 : 0));
    }
    context.textAlign = 'left';
    context.fillText(`−${SPAN} s`, left, height - 4);
    context.textAlign = 'right';
    context.fillText('now', width, height - 4);
    context.save();
    context.beginPath();
    context.rect(left, 0, width - left, height);
    context.clip();
    for (const curve of curves) {
      this.ink(context, curve);
      context.beginPath();
      let isDown = false;
      curve.times.forEach((time, at) => {
        const value = curve.values[at];
        if (!Number.isFinite(value)) isDown = false;
        else if (isDown) context.lineTo(x(time), y(value));
        else [isDown] = [true, context.moveTo(x(time), y(value))];
      });
      context.stroke();
    }
    context.restore();
    for (const curve of curves) {
      curve.output.textContent = curve.variable.text(curve.variable.value());
      const key = fitted(curve.key);
      this.ink(key.context, curve);
      key.context.beginPath();
      key.context.moveTo(0, key.height / 2);
      key.context.lineTo(key.width, key.height / 2);
      key.context.stroke();
    }
  }

  ink(context, curve) {
    context.strokeStyle = this.colors[curve.style];
    context.setLineDash(DASHES[curve.style]);
    context.lineWidth = 2;
  }
}
