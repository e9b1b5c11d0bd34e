// The robot: capsules, tendons and balls in the order of their distance, in parallel projection.

import { color, fitted } from './element.js';

const TURN = Math.PI / 24, ZOOM = 1.15;
// The least difference of tensions between the weakest and the strongest colour, N.
const LEAST = 1;

export class Figure {
  constructor(canvas, changed) {
    Object.assign(this, { canvas, changed, scene: null, about: -2.2, above: 0.5, zoom: 1, reach: null, range: null });
    const turns = {
      left: () => { this.about += TURN; }, right: () => { this.about -= TURN; },
      up: () => this.tilt(TURN), down: () => this.tilt(-TURN),
      near: () => this.resize(ZOOM), far: () => this.resize(1 / ZOOM),
    };
    this.turn = name => { turns[name](); changed(); };
    const keys = { ArrowLeft: 'left', ArrowRight: 'right', ArrowUp: 'up', ArrowDown: 'down', '+': 'near', '=': 'near', '-': 'far' };
    canvas.addEventListener('keydown', event => {
      if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.turn(keys[event.key]);
    });
    canvas.addEventListener('pointerdown', event => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener('pointermove', event => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      this.about -= event.movementX / 150;
      this.tilt(event.movementY / 150);
      changed();
    });
    this.recolor();
  }

  tilt(by) { this.above = Math.min(Math.max(this.above + by, -Math.PI / 2), Math.PI / 2); }
  resize(by) { this.zoom = Math.min(Math.max(this.zoom * by, 0.3), 6); }

  recolor() {
    const names = ['bone', 'bone-edge', 'ball', 'ball-edge', 'contact', 'slack', 'middle', 'taut', 'sheet'];
    this.colors = Object.fromEntries(names.map(name => [name, color(name)]));
    this.stops = ['slack', 'middle', 'taut'].map(name => this.colors[name].match(/[\d.]+/g).map(Number));
  }

  take(scene) {
    this.scene = scene;
    for (const { tension } of scene.lines) {
      if (typeof tension !== 'number') continue;
      const [least, greatest] = this.range ?? [tension, tension];
      this.range = [Math.min(least, tension), Math.max(greatest, tension)];
    }
    // The sphere about the middle of all that was drawn; it only grows, so that the picture rests.
    for (const [x, y, z] of scene.lines.flatMap(line => line.points)) {
      this.reach ??= [[x, x], [y, y], [z, z]];
      [x, y, z].forEach((it, axis) => {
        const [low, high] = this.reach[axis];
        this.reach[axis] = [Math.min(low, it), Math.max(high, it)];
      });
    }
    this.changed();
  }

  // The part of the range of tensions at which one is.
  part(tension) {
    const [least, greatest] = this.range;
    return (tension - least) / Math.max(greatest - least, LEAST);
  }

  tint(part) {
    const at = part < 0.5 ? 0 : 1;
    const [from, to] = this.stops.slice(at);
    return `rgb(${[0, 1, 2].map(it => Math.round(from[it] + (to[it] - from[it]) * (2 * part - at))).join(' ')})`;
  }

  width(part) { return 1 + 3.5 * part; }

  draw() {
    const { context, width, height } = fitted(this.canvas);
    if (!this.scene || !this.reach) return;
    const [sa, ca, se, ce] = [Math.sin(this.about), Math.cos(this.about), Math.sin(this.above), Math.cos(this.above)];
    const middle = this.reach.map(([low, high]) => (low + high) / 2);
    const radius = Math.hypot(...this.reach.map(([low, high]) => high - low)) / 2 || 0.1;
    const scale = this.zoom * Math.min(width, height) / (1.9 * radius);
    const see = point => {
      const [x, y, z] = point.map((it, axis) => it - middle[axis]);
      const [right, away] = [y * ca - x * sa, x * ca + y * sa];
      return [width / 2 + right * scale, height / 2 - (z * ce - away * se) * scale, away * ce + z * se];
    };
    const parts = [];
    for (const line of this.scene.lines) {
      const points = line.points.map(see);
      const [first, last] = [points[0], points.at(-1)];
      if (points.length > 3 && first.every((it, axis) => it === last[axis])) {
        parts.push({ far: farness(points), draw: () => this.plate(context, points, line.radius * scale) });
        continue;
      }
      for (let at = 1; at < points.length; at++) {
        const ends = [points[at - 1], points[at]];
        // A tendon lies on its bone.
        const far = farness(ends) - (line.isTendon ? 0.004 : 0);
        parts.push({ far, draw: () => this.stretch(context, ends, line, scale) });
      }
    }
    for (const object of this.scene.objects) {
      const at = see(object.center);
      parts.push({ far: at[2], draw: () => this.ball(context, at, object.radius * scale) });
      for (const contact of object.contacts) {
        const at = see(contact.at);
        parts.push({ far: at[2] - 0.02, draw: () => this.contact(context, at) });
      }
    }
    parts.sort((a, b) => b.far - a.far);
    for (const part of parts) part.draw();
  }

  plate(context, points, radius) {
    const path = new Path2D();
    points.forEach(([x, y], at) => (at ? path.lineTo(x, y) : path.moveTo(x, y)));
    path.closePath();
    context.lineJoin = 'round';
    for (const [style, more] of [['bone-edge', 2], ['bone', 0]]) {
      context.strokeStyle = context.fillStyle = this.colors[style];
      context.lineWidth = 2 * radius * 0.8 + more;
      context.fill(path);
      context.stroke(path);
    }
  }

  stretch(context, [[x, y], [u, v]], line, scale) {
    const path = new Path2D();
    path.moveTo(x, y);
    path.lineTo(u, v);
    context.lineCap = 'round';
    if (line.isTendon) {
      const part = typeof line.tension === 'number' ? this.part(line.tension) : 0;
      context.strokeStyle = this.tint(part);
      context.lineWidth = this.width(part);
      context.stroke(path);
      return;
    }
    const thick = Math.max(2 * line.radius * scale * 0.8, 3);
    for (const [style, more] of [['bone-edge', 2], ['bone', 0]]) {
      context.strokeStyle = this.colors[style];
      context.lineWidth = thick + more;
      context.stroke(path);
    }
    // The joint at its end.
    context.fillStyle = this.colors['bone-edge'];
    context.beginPath();
    context.arc(x, y, Math.max(thick / 7, 1.5), 0, 2 * Math.PI);
    context.fill();
  }

  ball(context, [x, y], radius) {
    const shade = context.createRadialGradient(x - radius / 3, y - radius / 3, radius / 8, x, y, radius);
    shade.addColorStop(0, this.colors.ball);
    shade.addColorStop(1, this.colors['ball-edge']);
    context.fillStyle = shade;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fill();
  }

  // A ring with a cross, so that it is known by its form.
  contact(context, [x, y]) {
    for (const [style, width] of [['sheet', 5], ['contact', 2]]) {
      context.strokeStyle = this.colors[style];
      context.lineWidth = width;
      context.beginPath();
      context.arc(x, y, 7, 0, 2 * Math.PI);
      context.moveTo(x - 4, y - 4);
      context.lineTo(x + 4, y + 4);
      context.moveTo(x + 4, y - 4);
      context.lineTo(x - 4, y + 4);
      context.stroke();
    }
  }

  // Draws the scale of tensions from the least to the greatest.
  legend(canvas) {
    const { context, width, height } = fitted(canvas);
    const steps = 24;
    for (let step = 0; step < steps; step++) {
      const part = step / (steps - 1), thick = this.width(part) * 2;
      context.fillStyle = this.tint(part);
      context.fillRect(step * width / steps, (height - thick) / 2, width / steps + 0.5, thick);
    }
  }
}

function farness(points) {
  return points.reduce((sum, point) => sum + point[2], 0) / points.length;
}
