// The page of `condor view`: it brings what comes from the server to its parts.

import { Link } from './link.js';
import { element, words } from './element.js';
import { Figure } from './figure.js';
import { Parameters } from './parameters.js';
import { Plots } from './plot.js';
import { Simulator } from './simulator.js';

// The greatest numbers of rows of the table, of suggested variables, and of lines of the log.
const ROWS = 40, SUGGESTED = 500, EVENTS = 200;
// After this time without a value of a loop, what is seen of it is old; so many of such loops are named.
const LATE_MS = 3000, NAMED = 4;
// Levels of events; what is less is not shown, and from a warning on it is read aloud.
const INFO = 20, WARN = 30, ERROR = 40;
const CHOSEN = 'condor.plots', TOKEN = 'condor.token';

const at = id => document.getElementById(id);
const isCalm = matchMedia('(prefers-reduced-motion: reduce)').matches;
const hz = isCalm ? 4 : 30;
const TABLE_MS = isCalm ? 1000 : 250;

// The token stands in no address that is sent, and in none that is seen for long.
function token() {
  const [, shown] = location.hash.match(/^#token=([0-9a-f]+)$/) ?? [];
  if (shown) {
    sessionStorage.setItem(TOKEN, shown);
    history.replaceState(null, '', location.pathname);
  }
  return sessionStorage.getItem(TOKEN);
}

let variables = [], dirty = new Set(), isAsked = false;

function need(part) {
  dirty.add(part);
  if (isAsked) return;
  isAsked = true;
  requestAnimationFrame(() => {
    isAsked = false;
    const parts = dirty;
    dirty = new Set();
    if (parts.has('figure')) drawFigure();
    if (parts.has('plots')) plots.draw();
    if (parts.has('simulator')) simulator.draw();
  });
}

// Robot

const figure = new Figure(at('figure'), () => need('figure'));
for (const button of document.querySelectorAll('[data-turn]')) {
  button.addEventListener('click', () => figure.turn(button.dataset.turn));
}

function drawFigure() {
  figure.draw();
  if (!figure.range) return;
  at('tensions').hidden = false;
  const [least, greatest] = figure.range.map(newton => `${newton.toFixed(1)} N`);
  if (at('least').textContent !== least || at('greatest').textContent !== greatest) {
    [at('least').textContent, at('greatest').textContent] = [least, greatest];
    figure.legend(at('scale'));
  }
}

function scene(now) {
  at('no-robot').hidden = true;
  const texts = now.objects.map(({ name, radius, contacts }) => {
    const force = contact => (contact.force === null ? '' : ` with ${contact.force.toFixed(1)} N`);
    const touching = contacts.map(contact => contact.name + force(contact)).join(', ') || 'nothing';
    return `The ${name}, ${(radius * 2000).toFixed(0)} mm wide, is touched by ${touching} (⊗).`;
  });
  const text = texts.join(' ');
  if (at('objects').textContent !== text) at('objects').textContent = text;
  figure.take(now);
  simulator.ghost(now);
}

// Plots

const plots = new Plots(at('panes'), () => need('plots'));
plots.removed = keep;

function keep() {
  sessionStorage.setItem(CHOSEN, JSON.stringify(plots.names()));
}

at('add').addEventListener('submit', event => {
  event.preventDefault();
  const name = at('variable').value.trim();
  const variable = variables.find(it => it.label === name);
  const trouble = variable ? plots.add(variable) : `There is no variable “${name}”.`;
  at('trouble').textContent = trouble;
  if (variable) at('variable').value = '';
  keep();
});

// Values

let shown = [];
at('value-filter').addEventListener('input', table);

function table() {
  const isFound = words(at('value-filter').value);
  const found = variables.filter(it => isFound(it.label));
  shown = found.slice(0, ROWS).map(variable => {
    const cell = element('td', { className: 'number' });
    const name = element('th', { scope: 'row', textContent: variable.label, title: variable.about });
    const unit = element('td', { textContent: variable.unit });
    const loop = element('td', { textContent: variable.rows.topic.slice(1) });
    return { variable, cell, row: element('tr', {}, name, cell, unit, loop) };
  });
  at('rows').replaceChildren(...shown.map(it => it.row));
  const more = found.length - ROWS;
  at('more-values').textContent = !found.length ? 'There is no such variable.'
    : more > 0 ? `${more} more: write a part of a name into the filter to see them.` : '';
  fill();
}

function fill() {
  for (const { variable, cell } of shown) {
    const text = variable.text(variable.value());
    if (cell.textContent !== text) cell.textContent = text;
  }
  const faults = variables.filter(it => /(^|\.)fault$/.test(it.name) && it.value());
  const names = faults.map(it => `${it.label.replace(/\.fault$/, '')} has a fault: ${it.text(it.value())}`).join('; ');
  const isTold = variables.some(it => /(^|\.)fault$/.test(it.name) && it.value() !== null);
  const text = names || (isTold ? 'No fault.' : 'No variable tells of a fault.');
  if (at('faults').textContent !== text) {
    at('faults').textContent = text;
    at('faults').className = names ? 'bad' : 'quiet';
    if (names) at('news').textContent = text;
  }
}

// What shows a robot that has stopped must not look alive.
function late() {
  const loops = [...new Set(variables.map(it => it.rows))];
  const quiet = loops.filter(it => it.view && performance.now() - it.came > LATE_MS).map(it => it.topic.slice(1));
  const named = quiet.length < loops.length ? quiet.slice(0, NAMED).join(', ') : 'any program';
  const more = quiet.length < loops.length && quiet.length > NAMED ? ` and ${quiet.length - NAMED} more` : '';
  const text = quiet.length ? `Nothing comes from ${named}${more}: it has stopped, or time stands. What is seen is old.` : '';
  if (at('late').textContent !== text) at('late').textContent = text;
  at('figure').classList.toggle('is-late', quiet.length > 0);
}

// Parameters

const parameters = new Parameters(
  { list: at('sliders'), filter: at('parameter-filter'), more: at('more-parameters') },
  (name, value) => link.set(name, value),
);

// Log

function event({ at: seconds, level, source, text }) {
  if (level < INFO) return;
  const kind = level >= ERROR ? 'Error: ' : level >= WARN ? 'Warning: ' : '';
  const time = seconds > 1e9 ? new Date(seconds * 1000).toLocaleTimeString() : `${seconds.toFixed(2)} s`;
  const line = element('p', { className: kind ? 'bad' : '' }, element('b', { textContent: source }), ` ${kind}${text}`);
  const list = at('events');
  const isAtEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 4;
  list.append(element('li', {}, element('time', { textContent: time }), line));
  if (list.children.length > EVENTS) list.firstChild.remove();
  if (isAtEnd) list.scrollTop = list.scrollHeight;
  if (kind) at('news').textContent = `${source}: ${kind}${text}`;
}

// The connection

// Hides a section, and the way to it.
function hide(section, isHidden) {
  at(section).hidden = document.querySelector(`nav [href="#${section}"]`).hidden = isHidden;
}

function rows(all, topics) {
  const each = all.flatMap(it => it.variables);
  const counts = new Map();
  for (const { name } of each) counts.set(name, (counts.get(name) ?? 0) + 1);
  for (const it of each) it.label = counts.get(it.name) > 1 ? `${it.rows.topic.slice(1)}:${it.name}` : it.name;
  variables = each;
  for (const section of ['plots', 'values']) hide(section, !each.length);
  for (const [section, topic] of [['robot', '/scene'], ['parameters', '/parameters'], ['log', '/events']]) {
    hide(section, !each.length && !topics.has(topic));
  }
  for (const column of document.querySelectorAll('.column')) column.hidden = !column.querySelector('section:not([hidden])');
  const options = each.slice(0, SUGGESTED).map(it => element('option', { value: it.label }));
  at('variables').replaceChildren(...options);
  plots.renew(variables);
  const chosen = JSON.parse(sessionStorage.getItem(CHOSEN) ?? '[]');
  for (const label of chosen) {
    const variable = variables.find(it => it.label === label);
    if (variable) plots.add(variable);
  }
  if (!plots.curves.length && each.length) plots.add(each.find(it => it.name.endsWith('.position')) ?? each[0]);
  table();
}

function state(text, isBad = false) {
  at('state').textContent = text;
  at('state').className = isBad ? 'bad' : '';
}

function allow(maySet) {
  parameters.maySet = maySet;
  parameters.build();
}

let refusal = '';
const link = new Link({ hz, token: token() }, {
  info({ name }) {
    document.title = `${name} – Condor`;
    at('name').textContent = name;
    if (link.token) refusal = '';
    state(link.token ? 'Connected; changes are allowed' : refusal ? 'Connected; this page only looks: its token is refused' : 'Connected; this page only looks', Boolean(refusal));
    at('trust').textContent = link.token ? ''
      : `${refusal && `Refused: ${refusal}. `}To set parameters, open the address with #token= that condor view has printed.`;
    parameters.renew();
    allow(Boolean(link.token));
  },
  rows,
  scene,
  services() {
    hide('simulator', !link.offers('/sim/robot'));
    if (link.offers('/sim/robot')) simulator.open(at('name').textContent, Boolean(link.token));
  },
  parameters: all => parameters.describe(all),
  values: (all, answered) => parameters.take(all, answered),
  event,
  status: ({ level, message }) => event({ at: Date.now() / 1000, level: level === 2 ? ERROR : WARN, source: 'server', text: message }),
  news() {
    plots.sample();
    need('plots');
  },
  closed(reason) {
    const why = reason ? `refused: ${reason}` : 'the server has ended, or cannot be reached';
    state(`Not connected: ${why}. This page tries again by itself; nothing in it is lost.`, true);
    allow(false);
  },
  // The token would be refused again: this page looks until somebody opens the new address.
  refused(reason) {
    refusal = reason;
    sessionStorage.removeItem(TOKEN);
  },
});
addEventListener('hashchange', () => {
  if (!location.hash.startsWith('#token=')) return;
  link.token = token();
  link.open();
});

const simulator = new Simulator(link, isCalm, () => need('simulator'), joints => {
  const found = joints.map(joint => variables.find(it => it.label === joint.position || it.name === joint.position)?.value() ?? null);
  return found.includes(null) ? null : found;
});
setInterval(fill, TABLE_MS);
setInterval(late, TABLE_MS);

function again() {
  figure.recolor();
  plots.recolor();
  simulator.recolor();
  at('least').textContent = '';
  need('figure');
  need('plots');
  need('simulator');
}
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', again);
const sizes = new ResizeObserver(again);
for (const canvas of document.querySelectorAll('.figure')) sizes.observe(canvas);
