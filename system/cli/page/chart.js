// Draws curves over time: those of the plots, and those of a plan.

import { color, fitted } from './element.js';

// Curves differ by their dashes, too.
export const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [5, 5], [14, 4]];
// The least room for the texts beside an axis.
const LEFT = 56;
// The gap between them and the axis.
const GAP = 8;
// The part of the range of values that is free above and below them.
const ROOM = 0.08;

// Returns the colours of curves, in the present scheme.
export function colors() {
  const curves = DASHES.map((_, style) => color(`curve-${style}`));
  const [edge, quiet, text, sheet, limit] = ['edge', 'quiet', 'text', 'sheet', 'bad'].map(color);
  return { curves, edge, quiet, text, sheet, limit };
}

export function ink(context, colors, style) {
  context.strokeStyle = colors.curves[style];
  context.setLineDash(DASHES[style]);
  context.lineWidth = 2;
}

// Draws the sample of a curve.
export function key(canvas, colors, style) {
  const { context, width, height } = fitted(canvas);
  ink(context, colors, style);
  line(context, [0, height / 2], [width, height / 2]);
}

// Draws curves with `times`, `values` and `style`. `span` is the first and the last time that is shown, `ends` are the
// texts for them; `limits` are values that are drawn if they are near, and `now` is a time that is marked.
export function chart(canvas, colors, { curves, span: [from, to], ends, limits = [], now = null }) {
  const { context, width, height } = fitted(canvas);
  const all = curves.flatMap(curve => curve.values).filter(Number.isFinite);
  let [low, high] = range(all);
  const size = Math.max(high - low, Math.abs(low), Math.abs(high));
  const near = limits.filter(limit => limit > low - size && limit < high + size);
  if (near.length && all.length) [low, high] = [Math.min(low, ...near), Math.max(high, ...near)];
  const room = (high - low) * ROOM || Math.abs(high) * 0.05 || 0.5;
  [low, high] = [low - room, high + room];
  const bottom = height - 20;
  const y = value => bottom - (value - low) / (high - low) * (bottom - 6);
  // As many digits as tell the lines apart.
  const digits = Math.min(Math.max(1 - Math.floor(Math.log10(high - low)), 0), 9);
  context.font = '12px system-ui, sans-serif';
  const marks = [0, 0.5, 1].map(part => [part, mark(low + (high - low) * part, digits)]);
  const left = Math.max(LEFT, GAP + Math.ceil(Math.max(...marks.map(([, text]) => context.measureText(text).width))));
  const x = time => left + (time - from) / (to - from || 1) * (width - left);
  context.fillStyle = colors.quiet;
  context.strokeStyle = colors.edge;
  context.lineWidth = 1;
  context.setLineDash([]);
  for (const [part, text] of marks) {
    const at = Math.round(y(low + (high - low) * part)) + 0.5;
    line(context, [left, at], [width, at]);
    context.textAlign = 'right';
    context.fillText(text, left - GAP, at + (part === 1 ? 8 : part ? 4 : 0));
  }
  context.textAlign = 'left';
  context.fillText(ends[0], left, height - 4);
  context.textAlign = 'right';
  context.fillText(ends[1], width, height - 4);
  context.save();
  context.beginPath();
  context.rect(left, 0, width - left, height);
  context.clip();
  context.strokeStyle = colors.limit;
  context.setLineDash([1, 3]);
  for (const limit of near) line(context, [left, y(limit)], [width, y(limit)]);
  for (const curve of curves) {
    ink(context, colors, curve.style);
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
  if (now !== null) {
    context.strokeStyle = colors.text;
    context.lineWidth = 1;
    context.setLineDash([]);
    line(context, [x(now), 0], [x(now), bottom]);
  }
  context.restore();
}

function range(all) {
  // Of more values than a call may have arguments.
  const low = all.reduce((least, value) => Math.min(least, value), Infinity);
  const high = all.reduce((most, value) => Math.max(most, value), -Infinity);
  return all.length ? [low, high] : [0, 1];
}

// Returns the text of a value beside an axis. None is minus nothing.
function mark(value, digits) {
  if (Math.abs(value) >= 1e6) return value.toExponential(2);
  return value.toFixed(digits).replace(/^-(0\.?0*)$/, '$1');
}

function line(context, from, to) {
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
}
