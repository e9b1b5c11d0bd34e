// The simulator: it brings its parts together, and keeps what is composed.

import { say, short } from './element.js';
import { Figure } from './figure.js';
import { Files } from './files.js';
import { Handles } from './handles.js';
import { History } from './history.js';
import { Latest } from './link.js';
import { Plan, posture, spans } from './plan.js';
import { Play } from './play.js';
import { Pose } from './pose.js';
import { Posture } from './posture.js';
import { Queue } from './queue.js';
import { Steps } from './steps.js';

// The time after the last change of a text until it is planned, and after the last movement until it is said, ms.
const PLAN_MS = 200, SAY_MS = 150;
const NOTHING = 'There is no step yet: move joints or tips, and add the posture as a step.';

const at = id => document.getElementById(`sim-${id}`);
const mm = metres => (1e3 * metres).toFixed(1);

export class Simulator {
  // `draw` is called when something is to be drawn, and `measured` returns the measured positions of variables, or null.
  constructor(link, isCalm, draw, measured) {
    Object.assign(this, { link, robot: null, asked: null });
    Object.assign(this, { text: '', positions: [], from: [], file: '' });
    this.figure = new Figure(at('figure'), draw);
    for (const button of document.querySelectorAll('[data-sim-turn]')) {
      button.onclick = () => this.figure.turn(button.dataset.simTurn);
    }
    this.pose = new Pose(link, (answer, isOld) => this.posed(answer, isOld), error => this.trouble(error));
    const edited = call => (...all) => {
      this.play.stop();
      call(...all);
      this.history.note();
    };
    this.posture = new Posture({ list: at('joints'), filter: at('filter'), more: at('more') }, edited((joint, position) => {
      this.asked = null;
      this.pose.move(joint, position);
    }));
    const point = ['x', 'y', 'z'].map(at);
    const bring = edited((name, to) => {
      this.asked = name;
      this.pose.bring(name, to);
    });
    const pose = this.pose;
    this.handles = new Handles({ list: at('handles'), point }, this.figure, { bring, get isBusy() { return pose.isBusy; } });
    this.steps = new Steps(at('steps'), {
      changed: steps => this.written(steps),
      show: edited(positions => this.take(positions)),
      state: () => ({
        names: this.robot.joints.map(joint => joint.name), from: this.from, positions: this.positions,
        planned: time => this.plan.plan && posture(this.plan.plan, time),
      }),
    });
    const nodes = { said: at('plan-said'), all: at('plan'), warned: at('warnings'), peaks: at('peaks'), curves: at('curves'), events: at('events') };
    this.plan = new Plan(nodes, draw);
    this.play = new Play({ button: at('play'), slider: at('time'), now: at('now') }, isCalm, {
      // The posture before comes back by undo.
      begins: () => this.history.commit(),
      show: time => {
        this.plan.now = time;
        this.take(posture(this.plan.plan, time));
        draw();
      },
      ends: () => this.history.note(),
    });
    this.history = new History(() => this.state(), () => this.buttons());
    const text = () => this.text;
    const files = { file: at('file'), open: at('open'), name: at('name'), save: at('save'), replace: at('replace'), said: at('file-said') };
    this.files = new Files(link, files, { text, opened: (text, file) => { this.file = file; this.rewrite(text); } });
    this.queue = new Queue(link, { button: at('enqueue'), control: at('control'), said: at('outcome') }, text);
    this.calls(link);
    this.controls(measured, edited);
  }

  // The calls that follow from a text.
  calls(link) {
    this.reading = new Latest(link, '/sim/steps', ({ steps }, isOld) => {
      if (isOld) return;
      this.contents = steps;
      this.steps.take(steps.motion ?? []);
      say(at('text-trouble'), '');
      if (!(steps.motion ?? []).length) this.planned(null, NOTHING);
    }, error => {
      if (error.isClosed) return;
      say(at('text-trouble'), error.message);
    });
    this.planning = new Latest(link, '/sim/plan', (plan, isOld) => {
      if (!isOld && this.text.trim()) this.planned(plan);
    }, error => {
      if (!error.isClosed) this.planned(null, `There is no plan: ${error.message}`);
    });
    this.writing = new Latest(link, '/sim/text', ({ text }, isOld) => {
      if (!isOld) this.rewrite(text);
    }, error => {
      say(at('text-trouble'), error.isClosed ? 'The change of the steps is lost, since the connection has closed.' : error.message);
      // The steps of the text as it is.
      this.steps.take([]);
      this.reading.ask(() => ({ text: this.text }));
    });
  }

  controls(measured, edited) {
    at('undo').onclick = () => this.restore(this.history.undo());
    at('redo').onclick = () => this.restore(this.history.redo());
    at('rest').onclick = edited(() => this.take(this.robot.start));
    at('measured').onclick = edited(() => {
      const positions = measured(this.robot.joints);
      if (positions) this.take(positions);
      else say(at('trouble'), 'No measured positions have come yet.');
    });
    at('from-here').onclick = () => this.begin([...this.positions]);
    at('from-rest').onclick = () => this.begin([...this.robot.start]);
    at('add').onclick = () => say(at('text-trouble'), this.steps.add());
    at('text').oninput = () => {
      this.text = at('text').value;
      this.history.note();
      this.check();
    };
    at('shows-ghost').onchange = () => this.ghost(this.measuredScene);
    addEventListener('keydown', event => this.key(event));
  }

  // Undoes by the usual keys, unless somebody writes elsewhere.
  key(event) {
    if (!this.robot || !(event.ctrlKey || event.metaKey) || event.altKey) return;
    const { target } = event;
    const isElsewhere = target !== document.body && !document.getElementById('simulator').contains(target);
    if (isElsewhere || target.type === 'search' || target === at('name')) return;
    const name = event.key.toLowerCase();
    const isRedo = name === 'y' || (name === 'z' && event.shiftKey);
    if (!isRedo && name !== 'z') return;
    event.preventDefault();
    this.restore(isRedo ? this.history.redo() : this.history.undo());
  }

  // Begins, or goes on, with the robot of a server.
  async open(server, maySet) {
    const robot = await this.link.call('/sim/robot', {}).catch(error => this.trouble(error));
    if (!robot) return;
    const isSame = JSON.stringify(robot.joints) === JSON.stringify(this.robot?.joints) && server === this.server;
    [this.robot, this.server] = [robot, server];
    at('files').hidden = !robot.hasMotions;
    at('queue').hidden = !robot.hasQueue;
    if (!isSame) {
      this.history.commit();
      this.posture.describe(robot.joints);
      this.handles.describe(robot.handles);
      this.restore(this.kept(server));
    } else {
      this.pose.take(this.positions);
      this.check();
    }
    at('save').disabled = !maySet;
    const what = [robot.hasMotions && 'save', robot.hasQueue && 'enqueue'].filter(Boolean).join(' or ');
    say(at('trust'), maySet || !what ? '' : `To ${what} motions, open the address with #token= that the server has printed.`);
    this.queue.allow(maySet);
    if (robot.hasMotions) this.files.list().catch(error => this.trouble(error));
  }

  // Returns what was composed for the robot of a server before, or the beginning.
  kept(server) {
    const { joints, start } = this.robot;
    const isPosture = all => Array.isArray(all) && all.length === joints.length && all.every(Number.isFinite);
    const kept = this.history.open(server);
    const { text = '', positions = start, from = start, file = '' } = kept ?? {};
    return {
      text: String(text), file: String(file),
      positions: isPosture(positions) ? positions : start,
      from: isPosture(from) ? from : start,
    };
  }

  state() {
    const { text, positions, from, file } = this;
    return { text, positions, from, file };
  }

  restore(state) {
    if (!state) return;
    this.play.stop();
    const { text, from, file } = state;
    Object.assign(this, { from, file, text });
    at('text').value = text;
    this.files.name(file);
    this.started();
    this.take(state.positions);
    this.history.commit();
    this.buttons();
    this.check();
  }

  buttons() {
    at('undo').disabled = !this.history.past.length;
    at('redo').disabled = !this.history.future.length;
  }

  // Takes a posture.
  take(positions) {
    this.asked = null;
    this.positions = [...positions];
    this.pose.take(positions);
  }

  posed({ positions, held, isReached, distance, scene, handles, clearances }, isOld) {
    this.positions = this.pose.positions;
    this.posture.show(this.positions);
    this.figure.take(scene);
    this.handles.show(handles);
    const meet = clearances.filter(it => it.distance < 0);
    this.figure.marks = meet.map(({ points: [one, other] }) => one.map((it, axis) => (it + other[axis]) / 2));
    if (isOld) return;
    say(at('trouble'), '');
    const limits = held.map(({ joint, limit }) => `${joint} is at its limit, ${short(limit)} rad`).join('; ');
    const isFar = isReached === false;
    const text = isFar ? `${this.asked} stays ${mm(distance)} mm from there: ${limits || 'it is out of reach'}.` : limits && `${limits}.`;
    const near = meet.length ? meet.map(it => `${it.parts.join(' and ')} meet, ${mm(-it.distance)} mm deep`).join('; ')
      : clearances.length ? `Closest parts: ${clearances[0].parts.join(' and ')}, ${mm(clearances[0].distance)} mm` : '';
    clearTimeout(this.saying);
    this.saying = setTimeout(() => {
      say(at('held'), text);
      say(at('clearances'), near && `${near}.`);
      at('clearances').className = meet.length ? 'bad' : 'quiet';
    }, SAY_MS);
  }

  trouble(error) {
    if (!error.isClosed) say(at('trouble'), error.message);
  }

  // Takes another posture from which the motion starts.
  begin(positions) {
    this.from = positions;
    this.started();
    this.history.note();
    this.check();
  }

  started() {
    const isRest = this.from.every((position, joint) => Math.abs(position - this.robot.start[joint]) < 1e-6);
    say(at('from'), `The motion starts ${isRest ? 'at rest' : 'in a posture that was chosen'}.`);
  }

  // Has other steps written as a text.
  written(steps) {
    const contents = { ...this.contents, motion: steps };
    this.history.commit();
    this.writing.ask(() => ({ steps: contents }));
  }

  rewrite(text) {
    this.text = text;
    at('text').value = text;
    this.history.note();
    this.check();
  }

  // Has the text read and planned, when it has been as it is for a moment.
  check() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.reading.ask(() => ({ text: this.text }));
      if (this.text.trim()) this.planning.ask(() => ({ from: this.from, text: this.text }));
    }, PLAN_MS);
  }

  planned(plan, why) {
    this.plan.now = null;
    this.plan.take(plan, why);
    this.play.describe(plan?.duration ?? 0);
    this.steps.time(plan ? spans(plan) : [], plan?.duration ?? 0);
  }

  // Takes the scene of the measured posture.
  ghost(scene) {
    this.measuredScene = scene;
    if (!this.robot || !scene) return;
    at('ghost').hidden = at('measured').hidden = false;
    this.figure.ghost = at('shows-ghost').checked ? scene : null;
    this.figure.changed();
  }

  recolor() {
    this.figure.recolor();
    this.plan.recolor();
  }

  draw() {
    if (!this.robot) return;
    this.figure.draw();
    this.plan.draw();
  }
}
