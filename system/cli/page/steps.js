// The steps of a motion on a time line. They are the contents of its file, as the robot reads it.

import { element, say, short } from './element.js';

const PROFILES = ['minimum-jerk', 'cubic', 'trapezoid', 'jerk-limited'];
const BEGINS = { after: 'after all before it', beside: 'beside others', now: 'at once' };
const ENDS = { next: 'the next follows', hold: 'waits for “resume”' };
const PACES = { duration: 'in seconds', speed: 'as a part of the limits' };
// The pace of a new step, and of one whose kind of pace is changed.
const USUAL = { duration: 1, speed: 0.1 };
// The least difference of positions that a step moves, rad or m.
const LEAST = 1e-4;

// Returns the line or the arc along which a step takes a tip, if it does.
const path = ({ line, arc }) => line ?? arc;

// Returns the positions after so many steps from others; `planned` returns those of the plan at the end of a step, if
// there is one.
function after(steps, from, names, count, planned) {
  const positions = new Map(names.map((name, joint) => [name, from[joint]]));
  steps.slice(0, count).forEach((step, number) => {
    const { to = {}, by = {} } = step;
    for (const [name, position] of Object.entries(to)) positions.set(name, position);
    for (const [name, more] of Object.entries(by)) positions.set(name, positions.get(name) + more);
    const found = path(step) && planned(number);
    names.forEach((name, joint) => {
      if (found && name.startsWith(`${path(step).finger}.`)) positions.set(name, found[joint]);
    });
  });
  return names.map(name => positions.get(name));
}

export class Steps {
  // `changed` is called with other steps, and `show` with a posture. `state` returns the names of joints, the
  // positions at the start, the present ones, and a function that returns those of the plan at a time, if there is one.
  constructor(list, { changed, show, state }) {
    Object.assign(this, { list, changed, show, state, steps: [], spans: [], duration: 0, open: new Set() });
  }

  // Shows steps.
  take(steps) {
    if (JSON.stringify(steps) === JSON.stringify(this.steps)) return;
    this.steps = steps;
    this.build();
  }

  // Shows when steps run; there is no span of a step that never runs.
  time(spans, duration) {
    [this.spans, this.duration] = [spans, duration];
    this.bars();
  }

  change(steps) {
    this.take(steps);
    this.changed(steps);
  }

  edit(number, edit) {
    const steps = structuredClone(this.steps);
    edit(steps[number]);
    this.change(steps);
  }

  // Returns the positions after so many steps.
  after(count) {
    const { names, from, planned } = this.state();
    return after(this.steps, from, names, count, number => this.spans[number] && planned(this.spans[number][1]));
  }

  // Adds a step to the present posture; returns the reason for which it cannot.
  add() {
    const { names, positions } = this.state();
    const end = this.after(this.steps.length);
    const to = this.targets(names, positions, end);
    if (!Object.keys(to).length) return 'The motion ends in this posture already: move a joint or a tip first.';
    this.change([...this.steps, { profile: PROFILES[0], duration: USUAL.duration, to }]);
    return '';
  }

  targets(names, positions, before) {
    const moved = names.map((name, joint) => [name, short(positions[joint]), before[joint]]);
    return Object.fromEntries(moved.filter(([, position, old]) => Math.abs(position - old) > LEAST));
  }

  // Takes the present posture as the target of a step.
  replace(number) {
    const { names, positions } = this.state();
    const before = this.after(number);
    this.edit(number, step => {
      const isOf = name => name in (step.to ?? {}) || name in (step.by ?? {});
      const own = names.filter(isOf).map(name => [name, short(positions[names.indexOf(name)])]);
      step.to = { ...Object.fromEntries(own), ...this.targets(names, positions, before) };
      delete step.by;
      // A point on the way has all joints of its step, as positions.
      for (const { joints } of step.via ?? []) {
        for (const name of Object.keys(step.to)) {
          const old = before[names.indexOf(name)];
          joints[name] = name in (this.steps[number].by ?? {}) ? short(old + joints[name]) : joints[name] ?? old;
        }
      }
    });
  }

  // Has a step pass the present posture on its way.
  pass(number) {
    const { names, positions } = this.state();
    const before = this.after(number);
    this.edit(number, step => {
      const of = name => positions[names.indexOf(name)] - (name in (step.by ?? {}) ? before[names.indexOf(name)] : 0);
      const all = [...Object.keys(step.to ?? {}), ...Object.keys(step.by ?? {})];
      const joints = Object.fromEntries(all.map(name => [name, short(of(name))]));
      const last = step.via?.at(-1)?.at ?? 0;
      step.via = [...step.via ?? [], { at: short((1 + last) / 2), joints }];
    });
  }

  move(number, to) {
    const steps = [...this.steps];
    steps.splice(to, 0, ...steps.splice(number, 1));
    const isOpen = [number, to].map(it => this.open.has(it));
    [to, number].forEach((it, at) => this.open[isOpen[at] ? 'add' : 'delete'](it));
    this.change(steps);
    this.list.querySelector(`[data-key="${to} ${to < number ? 'earlier' : 'later'}"]:enabled, [data-key="${to} summary"]`)?.focus();
  }

  remove(number) {
    this.open = new Set([...this.open].filter(it => it !== number).map(it => (it > number ? it - 1 : it)));
    this.change(this.steps.filter((_, it) => it !== number));
    const next = Math.min(number, this.steps.length - 1);
    this.list.querySelector(`[data-key="${next} summary"]`)?.focus();
  }

  build() {
    const key = document.activeElement?.dataset.key;
    this.list.replaceChildren(...this.steps.map((step, number) => this.item(step, number)));
    if (key) this.list.querySelector(`[data-key="${key}"]`)?.focus();
    this.bars();
  }

  item(step, number) {
    const summary = element('summary', {}, element('b', { textContent: `Step ${number + 1}` }), ` ${about(step)} `);
    summary.dataset.key = `${number} summary`;
    const when = element('span', { className: 'when' });
    const bar = element('span', { className: 'bar-of-time' });
    summary.append(when, element('span', { className: 'track', ariaHidden: 'true' }, bar));
    const details = element('details', { open: this.open.has(number) }, summary, this.form(step, number));
    details.ontoggle = () => this.open[details.open ? 'add' : 'delete'](number);
    return Object.assign(element('li', {}, details), { when, bar });
  }

  form(step, number) {
    const pace = step.speed === undefined ? 'duration' : 'speed';
    const set = key => value => this.edit(number, it => { it[key] = value; });
    const paces = this.choice(number, 'Pace', PACES, pace, kind => this.edit(number, it => {
      delete it[pace];
      it[kind] = USUAL[kind];
    }));
    const size = pace === 'duration' ? 'Duration, s' : 'Speed, part of 1';
    const profiles = Object.fromEntries(PROFILES.map(name => [name, name]));
    // A line or an arc begins at rest, and has one profile.
    const isPath = Boolean(path(step));
    const { now, ...atRest } = BEGINS;
    const fields = [
      paces,
      this.number(number, size, step[pace], set(pace)),
      !isPath && this.choice(number, 'Profile', profiles, step.profile, set('profile')),
      this.choice(number, 'Begins', isPath ? atRest : { ...atRest, now }, step.begin ?? 'after', set('begin')),
      !isPath && this.number(number, 'Blend, s', step.blend ?? 0, set('blend')),
      this.choice(number, 'At its end', ENDS, step['on-end'] ?? 'next', set('on-end')),
    ].filter(Boolean);
    const vias = (step.via ?? []).map((via, place) => this.via(number, via, place));
    const conditions = [condition('Begins on', step.start), condition('Stops on', step.stop)].filter(Boolean);
    const last = this.steps.length - 1;
    const buttons = [
      this.button(number, 'show', 'Show its end', () => this.show(this.after(number + 1))),
      !isPath && this.button(number, 'replace', 'End in the present posture', () => this.replace(number)),
      !isPath && this.button(number, 'pass', 'Pass the present posture', () => this.pass(number)),
      this.button(number, 'earlier', 'Earlier', () => this.move(number, number - 1), number === 0),
      this.button(number, 'later', 'Later', () => this.move(number, number + 1), number === last),
      this.button(number, 'remove', 'Remove', () => this.remove(number)),
    ].filter(Boolean);
    return element('div', { className: 'step' },
      element('div', { className: 'fields' }, ...fields),
      ...targets('Moves to', step.to), ...targets('Moves by', step.by), ...along(step), ...vias,
      ...conditions.map(textContent => element('p', { textContent })),
      element('div', { className: 'bar' }, ...buttons));
  }

  via(number, via, place) {
    const at = this.number(number, `Point ${place + 1}, part of the time`, via.at, value => this.edit(number, step => {
      step.via[place].at = value;
    }));
    const remove = this.button(number, `via ${place}`, 'Remove the point', () => this.edit(number, step => {
      step.via.splice(place, 1);
      if (!step.via.length) delete step.via;
    }));
    return element('div', { className: 'fields' }, at, ...targets('Passes', via.joints), remove);
  }

  choice(number, label, texts, value, set) {
    const options = Object.entries(texts).map(([value, textContent]) => element('option', { value, textContent }));
    const list = element('select', {}, ...options);
    list.value = value;
    list.onchange = () => set(list.value);
    list.dataset.key = `${number} ${label}`;
    return element('label', {}, label, list);
  }

  number(number, label, value, set) {
    const field = element('input', { type: 'number', step: 'any', min: 0, value });
    field.onchange = () => {
      if (field.value !== '' && field.checkValidity()) set(field.valueAsNumber);
      else field.reportValidity();
    };
    field.dataset.key = `${number} ${label}`;
    return element('label', {}, label, field);
  }

  button(number, key, textContent, onclick, disabled = false) {
    const button = element('button', { type: 'button', textContent, onclick, disabled });
    button.setAttribute('aria-label', `${textContent}: step ${number + 1}`);
    button.dataset.key = `${number} ${key}`;
    return button;
  }

  bars() {
    [...this.list.children].forEach((item, number) => {
      const span = this.spans[number];
      say(item.when, span ? `${span[0].toFixed(2)} to ${span[1].toFixed(2)} s` : '');
      const [from, to] = span && this.duration ? span.map(time => 100 * time / this.duration) : [0, 0];
      [item.bar.style.left, item.bar.style.width] = [`${from}%`, `${to - from}%`];
    });
  }
}

function about({ duration, speed, profile, to = {}, by = {}, line, arc }) {
  const pace = speed === undefined ? `${duration} s` : `${(100 * speed).toFixed(0)} % of the limits`;
  if (line ?? arc) return `${(line ?? arc).finger} along ${line ? 'a line' : 'an arc'}, ${pace}`;
  const names = [...Object.keys(to), ...Object.keys(by)];
  const joints = names.length > 2 ? `${names.length} joints` : names.join(', ');
  return `${joints}, ${profile}, ${pace}`;
}

function targets(label, joints = {}) {
  const all = Object.entries(joints).map(([name, position]) => `${name} ${position}`);
  return all.length ? [element('p', { textContent: `${label}: ${all.join(', ')}` })] : [];
}

function along({ line, arc }) {
  const way = line ?? arc;
  if (!way) return [];
  const point = numbers => `(${numbers.join(', ')}) m`;
  const parts = [arc && `through ${point(arc.through)}`, way.to && `to ${point(way.to)}`, way.by && `by ${point(way.by)}`];
  return [element('p', { textContent: `Its tip goes ${parts.filter(Boolean).join(' ')}` })];
}

function condition(label, { torque, effort, time, contact } = {}) {
  const all = [
    torque !== undefined && `a torque of ${torque} N m`, effort !== undefined && `an effort of ${effort} N or N m`,
    contact && 'contact', time !== undefined && `${time} s passed`,
  ].filter(Boolean);
  return all.length ? `${label}: ${all.join(', or ')}` : '';
}
