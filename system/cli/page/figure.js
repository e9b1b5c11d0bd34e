// The robot: capsules, tendons and balls in the order of their distance, in parallel projection.

import { color, fitted } from './element.js';

const TURN = Math.PI / 24, ZOOM = 1.15;
// The least difference of efforts between the weakest and the strongest colour, N.
const LEAST = 1;
// The length of the arrow of a contact for each newton, m.
const FORCE = 0.003;

// Of a handle on the screen: its radius, and how far from it a mouse and a finger take it, px.
const HANDLE = 8, NEAR = { mouse: 14, touch: 26, pen: 18 };

export class Figure {
  constructor(canvas, changed) {
    Object.assign(this, { canvas, changed, scene: null, about: -2.2, above: 0.5, zoom: 1, reach: null, range: null });
    // Another pose, which is drawn as an outline; handles, each with `name`, `at` and `isChosen`; points that are marked.
    Object.assign(this, { ghost: null, handles: [], marks: [] });
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
    let held = null;
    canvas.addEventListener('pointerdown', event => {
      canvas.setPointerCapture(event.pointerId);
      held = this.grab(event);
    });
    canvas.addEventListener('pointermove', event => {
      if (!canvas.hasPointerCapture(event.pointerId)) {
        canvas.classList.toggle('is-over', Boolean(this.near(event)));
        return;
      }
      if (held) {
        held(event.offsetX, event.offsetY);
        return;
      }
      this.about -= event.movementX / 150;
      this.tilt(event.movementY / 150);
      changed();
    });
    // A finger on a handle moves the handle, and not the page.
    canvas.addEventListener('touchstart', event => {
      if (held && event.cancelable) event.preventDefault();
    }, { passive: false });
    this.recolor();
  }

  // Returns the handle at a pointer.
  near({ offsetX, offsetY, pointerType }) {
    const { see } = this.view();
    const far = handle => {
      const [x, y] = see(handle.at);
      return Math.hypot(x - offsetX, y - offsetY);
    };
    const within = this.handles.filter(handle => far(handle) <= (NEAR[pointerType] ?? NEAR.mouse));
    return within.sort((a, b) => far(a) - far(b))[0];
  }

  // Takes the handle at a pointer; returns what moves it in the plane of the screen.
  grab(event) {
    const handle = this.dragged && this.near(event);
    if (!handle) return null;
    const { offsetX, offsetY } = event, { name, at } = handle;
    this.chosen(name);
    return (x, y) => {
      const { scale } = this.view();
      this.dragged(name, this.moved(at, (x - offsetX) / scale, (offsetY - y) / scale, 0));
    };
  }

  // Moves a point to the right, up and away as it is seen, in metres.
  moved(at, right, up, away) {
    const [sa, ca, se, ce] = this.turns();
    const axes = [[-sa, ca, 0], [-ca * se, -sa * se, ce], [ca * ce, sa * ce, se]];
    return at.map((it, axis) => it + right * axes[0][axis] + up * axes[1][axis] + away * axes[2][axis]);
  }

  turns() { return [Math.sin(this.about), Math.cos(this.about), Math.sin(this.above), Math.cos(this.above)]; }

  // Returns how points are seen: to the right and down in px, and away.
  view(width = this.canvas.clientWidth, height = this.canvas.clientHeight) {
    const reach = this.reach ?? [[0, 0], [0, 0], [0, 0]];
    const [sa, ca, se, ce] = this.turns();
    const middle = reach.map(([low, high]) => (low + high) / 2);
    const radius = Math.hypot(...reach.map(([low, high]) => high - low)) / 2 || 0.1;
    const scale = this.zoom * Math.min(width, height) / (1.9 * radius);
    const see = point => {
      const [x, y, z] = point.map((it, axis) => it - middle[axis]);
      const [right, away] = [y * ca - x * sa, x * ca + y * sa];
      return [width / 2 + right * scale, height / 2 - (z * ce - away * se) * scale, away * ce + z * se];
    };
    return { see, scale };
  }

  tilt(by) { this.above = Math.min(Math.max(this.above + by, -Math.PI / 2), Math.PI / 2); }
  resize(by) { this.zoom = Math.min(Math.max(this.zoom * by, 0.3), 6); }

  recolor() {
    const names = ['bone', 'bone-edge', 'ball', 'ball-edge', 'contact', 'slack', 'middle', 'taut', 'sheet', 'ghost', 'bad', 'accent', 'text'];
    this.colors = Object.fromEntries(names.map(name => [name, color(name)]));
    this.stops = ['slack', 'middle', 'taut'].map(name => this.colors[name].match(/[\d.]+/g).map(Number));
  }

  take(scene) {
    this.scene = scene;
    for (const { effort } of scene.lines) {
      if (typeof effort !== 'number') continue;
      const [least, greatest] = this.range ?? [effort, effort];
      this.range = [Math.min(least, effort), Math.max(greatest, effort)];
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

  // The part of the range of efforts at which one is.
  part(effort) {
    const [least, greatest] = this.range;
    return (effort - least) / Math.max(greatest - least, LEAST);
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
    const { see, scale } = this.view(width, height);
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
        const from = see(contact.at.map((it, axis) => it + contact.normal[axis] * contact.force * FORCE));
        parts.push({ far: at[2] - 0.02, draw: () => this.contact(context, at, from) });
      }
    }
    parts.sort((a, b) => b.far - a.far);
    for (const part of parts) part.draw();
    for (const line of this.ghost?.lines ?? []) {
      if (!line.isTendon) this.outline(context, line.points.map(see), line.radius * scale * 0.8);
    }
    const last = [...this.handles].sort((a, b) => a.isChosen - b.isChosen);
    for (const handle of last) this.handle(context, see(handle.at), handle);
    for (const at of this.marks) this.mark(context, see(at));
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
      const part = typeof line.effort === 'number' ? this.part(line.effort) : 0;
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

  // A ring with a cross, so that it is known by its form, and an arrow as long as its force.
  contact(context, [x, y], [u, v]) {
    const along = Math.atan2(y - v, x - u), isLong = Math.hypot(x - u, y - v) > 14;
    for (const [style, width] of [['sheet', 5], ['contact', 2]]) {
      context.strokeStyle = this.colors[style];
      context.lineWidth = width;
      context.beginPath();
      context.arc(x, y, 7, 0, 2 * Math.PI);
      context.moveTo(x - 4, y - 4);
      context.lineTo(x + 4, y + 4);
      context.moveTo(x + 4, y - 4);
      context.lineTo(x - 4, y + 4);
      if (isLong) {
        const tip = [x - 7 * Math.cos(along), y - 7 * Math.sin(along)];
        context.moveTo(u, v);
        for (const turn of [-2.6, 2.6]) {
          context.lineTo(...tip);
          context.lineTo(tip[0] + 7 * Math.cos(along + turn), tip[1] + 7 * Math.sin(along + turn));
        }
      }
      context.stroke();
    }
  }

  // A dashed line about each part.
  outline(context, points, radius) {
    context.strokeStyle = this.colors.ghost;
    context.lineWidth = 1.5;
    context.setLineDash([4, 3]);
    for (let at = 1; at < points.length; at++) {
      const [[x, y], [u, v]] = [points[at - 1], points[at]];
      const along = Math.atan2(v - y, u - x), across = Math.PI / 2, round = Math.max(radius, 2);
      context.beginPath();
      context.arc(x, y, round, along + across, along - across);
      context.arc(u, v, round, along - across, along + across);
      context.closePath();
      context.stroke();
    }
    context.setLineDash([]);
  }

  // A triangle with an exclamation mark, above what it marks.
  mark(context, [x, under]) {
    const y = under - 26, path = new Path2D();
    path.moveTo(x, y - 10);
    path.lineTo(x + 10, y + 8);
    path.lineTo(x - 10, y + 8);
    path.closePath();
    context.lineJoin = 'round';
    for (const [style, width] of [['sheet', 9], ['bad', 5]]) {
      context.strokeStyle = context.fillStyle = this.colors[style];
      context.lineWidth = width;
      context.stroke(path);
      context.fill(path);
    }
    context.font = 'bold 14px system-ui, sans-serif';
    context.textAlign = 'center';
    context.fillStyle = this.colors.sheet;
    context.fillText('!', x, y + 6);
  }

  // A ring with a point; the chosen one is full and has its name.
  handle(context, [x, y], { name, isChosen }) {
    const rings = isChosen ? [['sheet', HANDLE + 4], ['accent', HANDLE + 2], ['sheet', 3]]
      : [['sheet', HANDLE + 2], ['accent', HANDLE], ['sheet', HANDLE - 3], ['accent', 2]];
    for (const [style, radius] of rings) {
      context.fillStyle = this.colors[style];
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.fill();
    }
    if (!isChosen) return;
    context.font = '600 13px system-ui, sans-serif';
    context.textAlign = x < this.canvas.clientWidth / 2 ? 'left' : 'right';
    const at = [x + (x < this.canvas.clientWidth / 2 ? 16 : -16), y + 4];
    context.lineJoin = 'round';
    context.lineWidth = 4;
    context.strokeStyle = this.colors.sheet;
    context.strokeText(name, ...at);
    context.fillStyle = this.colors.text;
    context.fillText(name, ...at);
  }

  // Draws the scale of efforts from the least to the greatest.
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
