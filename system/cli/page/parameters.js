// Parameters: a slider and a field for a number, a box for a boolean, a list for a choice.

import { element, words } from './element.js';

// The greatest number of parameters that are shown, and the steps of a slider.
const SHOWN = 24, STEPS = 200;
// Bounds that are so many times wider than a value say nothing of what is sensible.
const WIDE = 100;

export class Parameters {
  constructor(nodes, set) {
    Object.assign(this, { nodes, set, all: [], values: new Map(), inputs: new Map(), asked: new Map(), maySet: false });
    nodes.filter.addEventListener('input', () => this.build());
  }

  // Forgets what was asked of a connection that has closed.
  renew() { this.asked.clear(); }

  describe(all) {
    this.all = all;
    this.build();
  }

  // Takes values; `answered` is the parameter to whose setting they are the answer.
  take(values, answered) {
    if (this.asked.has(answered)) this.asked.set(answered, this.asked.get(answered) - 1);
    for (const { name, value } of values) this.values.set(name, value);
    for (const { name } of values) this.show(name);
    if (answered !== undefined) this.show(answered);
  }

  change(name, value) {
    this.asked.set(name, (this.asked.get(name) ?? 0) + 1);
    this.set(name, value);
  }

  build() {
    const isFound = words(this.nodes.filter.value);
    const found = this.all.filter(one => isFound(one.name));
    this.inputs.clear();
    this.nodes.list.replaceChildren(...found.slice(0, SHOWN).map((one, at) => this.row(one, `parameter-${at}`)));
    const more = found.length - SHOWN;
    this.nodes.more.textContent = !found.length ? 'There is no such parameter.'
      : more > 0 ? `${more} more: write a part of a name into the filter to see them.` : '';
    for (const { name } of found.slice(0, SHOWN)) this.show(name);
  }

  row(one, id) {
    const small = [one.unit, one.about].filter(Boolean).join(' · ');
    const label = element('label', { htmlFor: id }, one.name, ' ', element('small', { textContent: small }));
    const inputs = this.fields(one, id);
    for (const input of inputs) input.disabled = !this.maySet || Boolean(input.reach);
    this.inputs.set(one.name, inputs);
    return element('div', { className: 'parameter' }, label, ...inputs);
  }

  fields(one, id) {
    const send = value => this.change(one.name, value);
    if (one.type === 'bool') {
      const box = element('input', { type: 'checkbox', id });
      box.onchange = () => send(box.checked);
      return [box];
    }
    if (one.labels.length) {
      const options = one.labels.map(label => element('option', { textContent: label }));
      const list = element('select', { id }, ...options);
      list.onchange = () => send(list.value);
      return [list];
    }
    const [low, high] = one.bounds;
    const isWhole = !one.type.startsWith('f');
    const bounds = { min: low ?? '', max: high ?? '' };
    const field = element('input', { type: 'number', id, step: isWhole ? 1 : 'any', ...bounds });
    field.onchange = () => {
      if (field.value !== '' && field.checkValidity()) send(field.valueAsNumber);
      else field.reportValidity();
    };
    if (low === null || high === null) return [field];
    // Until the value is known, nobody can move it from another one.
    const slider = element('input', { type: 'range' });
    slider.setAttribute('aria-label', `${one.name}${one.unit ? `, ${one.unit}` : ''}`);
    slider.reach = value => {
      const far = Math.max(Math.abs(value), 1);
      const isWide = high - low > WIDE * far;
      const [from, to] = isWide ? [Math.max(low, value - far), Math.min(high, value + far)] : [low, high];
      const step = (to - from) / STEPS;
      Object.assign(slider, { min: from, max: to, step: isWhole ? Math.max(1, Math.round(step)) : step, disabled: !this.maySet });
    };
    slider.oninput = () => { field.value = Number(slider.valueAsNumber.toPrecision(6)); };
    slider.onchange = () => send(Number(slider.valueAsNumber.toPrecision(6)));
    return [slider, field];
  }

  // Shows a value, unless somebody is about to change it, or another one is on its way to the loop.
  show(name) {
    const value = this.values.get(name);
    if (value === undefined || this.asked.get(name) > 0) return;
    for (const input of this.inputs.get(name) ?? []) {
      if (input.type === 'checkbox') {
        input.checked = value;
        continue;
      }
      // What moves a slider stays where it is; its ends are set anew when it is at one of them.
      const isInside = input.min !== '' && value > Number(input.min) && value < Number(input.max);
      if (input.reach && (!isInside || input !== document.activeElement)) input.reach(value);
      if (input !== document.activeElement || input.type === 'range') input.value = value;
    }
  }
}
