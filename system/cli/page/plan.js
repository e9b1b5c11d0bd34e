// The plan of a motion: what it takes of each joint, and where it cannot be as it is written.

import { chart, colors, key } from './chart.js';
import { element, say } from './element.js';

const CURVES = [
  ['position', 'Position, rad', joint => joint.limits.position],
  ['velocity', 'Speed, rad/s', joint => [-joint.limits.velocity, joint.limits.velocity]],
  ['torque', 'Torque, N m', joint => joint.limits.torque],
];
const HAPPENS = {
  begins: 'begins', 'begins-adjusted': 'begins in a changed form, to keep the limits',
  reached: 'has reached its targets', stopped: 'is stopped by its time',
  superseded: 'ends, since another step takes its joints', dropped: 'is dropped', refused: 'is refused',
  waits: 'waits for a sensor: here the plan ends', holds: 'holds until “resume”',
};
const BEGINS = ['begins', 'begins-adjusted'], ENDS = ['reached', 'stopped', 'superseded', 'dropped', 'refused'];

const seconds = time => `${time.toFixed(2)} s`;
const within = ({ from_s: from, to_s: to }) => `${from.toFixed(2)} to ${to.toFixed(2)} s`;
const percent = part => (part === null || part === undefined ? '–' : `${(100 * part).toFixed(0)} %`);

// Returns what is wrong with a plan.
function warnings({ events, overloads, collisions }) {
  const refused = events.filter(({ what }) => what === 'refused' || what === 'waits');
  return [
    ...refused.map(event => `${seconds(event.at_s)}: step ${event.step} ${HAPPENS[event.what]}${event.reason ? `: ${event.reason}` : ''}`),
    ...overloads.map(it => `${within(it)}: the actuators of ${it.joint} cannot give ${it.torque.toFixed(3)} N m, but ${it.possible.toFixed(3)} N m`),
    ...collisions.map(it => `${within(it)}: ${it.parts.join(' and ')} meet, ${(-1e3 * it.distance_m).toFixed(1)} mm deep`),
  ];
}

// Returns the times in which each step runs.
export function spans({ events, duration }) {
  const all = [];
  for (const { at_s: at, step, what } of events) {
    if (BEGINS.includes(what)) all[step - 1] = [at, duration];
    if (ENDS.includes(what) && all[step - 1]) all[step - 1][1] = at;
  }
  return all;
}

// Returns the positions of all joints at a time.
export function posture({ joints, period, duration }, time) {
  return joints.map(({ position }) => {
    const last = position.length - 1, at = Math.min(Math.floor(time / period), last);
    if (at >= last) return position[last];
    const to = at + 1 === last ? duration : (at + 1) * period;
    const part = Math.min((time - at * period) / (to - at * period), 1);
    return position[at] + (position[at + 1] - position[at]) * part;
  });
}

export class Plan {
  constructor(nodes, changed) {
    Object.assign(this, { nodes, changed, plan: null, joint: null, panes: [], now: null });
    this.recolor();
  }

  recolor() { this.colors = colors(); }

  // Shows a plan; or, if there is none, why.
  take(plan, why = '') {
    const { said, all, warned, peaks, events } = this.nodes;
    this.plan = plan;
    all.hidden = !plan;
    if (!plan) {
      say(said, why);
      for (const node of [warned, peaks, events, this.nodes.curves]) node.replaceChildren();
      this.panes = [];
      return;
    }
    const wrong = warnings(plan);
    warned.replaceChildren(...wrong.map(text => element('li', {}, element('b', { textContent: 'Warning: ' }), text)));
    const meaning = wrong.length ? `${wrong.length} ${wrong.length > 1 ? 'warnings' : 'warning'}` : 'the robot can make it, and nothing meets';
    say(said, `The motion takes ${seconds(plan.duration)}: ${meaning}.`);
    const texts = plan.events.map(({ at_s: at, step, what }) => `${seconds(at)}: step ${step} ${HAPPENS[what] ?? what}`);
    events.replaceChildren(...texts.map(textContent => element('li', { textContent })));
    const key = document.activeElement?.dataset.joint;
    peaks.replaceChildren(...plan.peaks.map(peak => this.row(peak)));
    if (key) peaks.querySelector(`[data-joint="${CSS.escape(key)}"]`)?.focus({ preventScroll: true });
    const most = peak => Math.max(peak.velocity, peak.torque ?? 0, peak.effort ?? 0);
    const first = plan.peaks.reduce((best, peak) => (best && most(best) >= most(peak) ? best : peak), null);
    if (!plan.joints.some(joint => joint.name === this.joint)) this.joint = first?.joint ?? null;
    this.choose(this.joint);
  }

  row({ joint, velocity, torque, effort }) {
    const button = element('button', { type: 'button', textContent: joint, onclick: () => this.choose(joint) });
    button.dataset.joint = joint;
    const cells = [velocity, torque, effort].map(part => {
      const isOver = part > 1;
      return element('td', { className: isOver ? 'number bad' : 'number', textContent: `${isOver ? '⚠ ' : ''}${percent(part)}` });
    });
    return element('tr', {}, element('th', { scope: 'row' }, button), ...cells);
  }

  // Shows the curves of a joint.
  choose(name) {
    this.joint = name;
    for (const button of this.nodes.peaks.querySelectorAll('button')) {
      button.setAttribute('aria-pressed', button.textContent === name);
    }
    const joint = this.plan.joints.find(joint => joint.name === name);
    if (!joint) return;
    const { period, duration } = this.plan;
    const times = joint.position.map((_, at) => Math.min(at * period, duration));
    const panes = CURVES.map(([part, label, limits]) => ({ label, limits: limits(joint), curves: [[name, joint[part]]] }));
    if (joint.actuators.length) {
      const curves = joint.actuators.map(actuator => [actuator.name, actuator.effort]);
      const [least, greatest] = [0, 1].map(end => joint.actuators.map(actuator => actuator.limits[end]));
      panes.push({ label: 'Effort, N or N m', limits: [Math.min(...least), Math.max(...greatest)], curves });
    }
    this.panes = panes.map(pane => this.pane(pane, times));
    this.nodes.curves.replaceChildren(element('h4', { textContent: `Curves of ${name}` }), ...this.panes.map(pane => pane.node));
    this.changed();
  }

  pane({ label, limits, curves }, times) {
    const canvas = element('canvas', { role: 'img' });
    const [low, high] = curves.map(([, values]) => values).flat()
      .reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
    const short = value => String(Number(value.toPrecision(3)));
    const text = `from ${short(low)} to ${short(high)}; limits ${limits.map(short).join(' and ')}`;
    canvas.setAttribute('aria-label', `${label} over time, ${text}`);
    const keys = curves.length > 1 ? curves.map(([name], style) => ({ name, style, canvas: element('canvas', { ariaHidden: 'true' }) })) : [];
    const items = keys.map(({ name, canvas }) => element('li', {}, canvas, name));
    const list = items.length ? [element('ul', { className: 'curves' }, ...items)] : [];
    const title = element('h5', {}, label, element('small', { textContent: text }));
    const node = element('div', { className: 'pane' }, title, canvas, ...list);
    return { node, canvas, keys, limits, curves: curves.map(([, values], style) => ({ times, values, style })) };
  }

  draw() {
    if (!this.plan) return;
    const { duration } = this.plan;
    for (const { canvas, curves, limits, keys } of this.panes) {
      chart(canvas, this.colors, { curves, limits, span: [0, duration], ends: ['0 s', seconds(duration)], now: this.now });
      for (const it of keys) key(it.canvas, this.colors, it.style);
    }
  }
}
