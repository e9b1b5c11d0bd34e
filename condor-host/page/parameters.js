// Parameters: a slider and a field for a number, a box for a boolean, a list for a choice.

import { element } from './element.js';

// The greatest number of parameters that are shown, and the steps of a slider.
const SHOWN = 24, STEPS = 200;

export class Parameters {
  constructor(nodes, set) {
    Object.assign(this, { nodes, set, all: [], values: new Map(), inputs: new Map(), maySet: false });
    nodes.filter.addEventListener('input', () => this.build());
  }

  describe(all) {
    this.all = all;
    this.build();
  }

  take(values) {
    for (const { name, value } of values) {
      this.values.set(name, value);
      this.show(name);
    }
  }

  build() {
    const words = this.nodes.filter.value.toLowerCase().split(/\s+/);
    const found = this.all.filter(one => words.every(word => one.name.toLowerCase().includes(word)));
    this.inputs.clear();
    this.nodes.list.replaceChildren(...found.slice(0, SHOWN).map((one, at) => this.row(one, `parameter-${at}`)));
    const more = found.length - SHOWN;
    this.nodes.more.textContent = !found.length ? 'There is no such parameter.'
      : more > 0 ? `${more} more: write a part of a name into the filter.` : '';
    for (const { name } of found.slice(0, SHOWN)) this.show(name);
  }

  row(one, id) {
    const small = [one.unit, one.about].filter(Boolean).join(' · ');
    const label = element('label', { htmlFor: id }, one.name, ' ', element('small', { textContent: small }));
    const inputs = this.fields(one, id);
    for (const input of inputs) input.disabled = !this.maySet;
    this.inputs.set(one.name, inputs);
    return element('div', { className: 'parameter' }, label, ...inputs);
  }

  fields(one, id) {
    const send = value => this.set(one.name, value);
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
    const step = (high - low) / STEPS;
    const slider = element('input', { type: 'range', ...bounds, step: isWhole ? Math.max(1, Math.round(step)) : step });
    slider.setAttribute('aria-label', `${one.name}${one.unit ? `, ${one.unit}` : ''}`);
    slider.oninput = () => { field.value = Number(slider.valueAsNumber.toPrecision(6)); };
    slider.onchange = () => send(Number(slider.valueAsNumber.toPrecision(6)));
    return [slider, field];
  }

  // Shows a value, unless somebody is about to change it.
  show(name) {
    const value = this.values.get(name);
    if (value === undefined) return;
    for (const input of this.inputs.get(name) ?? []) {
      if (input.type === 'checkbox') input.checked = value;
      else if (input !== document.activeElement || input.type === 'range') input.value = value;
    }
  }
}
