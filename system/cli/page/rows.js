// What the messages of the server's channels contain: rows of variables, and texts.

// The bytes of a message before its fields, and of a row before those of its variables.
export const HEADER = 4;
const HEAD = 24;

const KINDS = {
  bool: [1, (view, at) => view.getUint8(at) !== 0],
  int8: [1, (view, at) => view.getInt8(at)],
  uint8: [1, (view, at) => view.getUint8(at)],
  int16: [2, (view, at) => view.getInt16(at, true)],
  uint16: [2, (view, at) => view.getUint16(at, true)],
  int32: [4, (view, at) => view.getInt32(at, true)],
  uint32: [4, (view, at) => view.getUint32(at, true)],
  int64: [8, (view, at) => Number(view.getBigInt64(at, true))],
  uint64: [8, (view, at) => Number(view.getBigUint64(at, true))],
  float32: [4, (view, at) => view.getFloat32(at, true)],
  float64: [8, (view, at) => view.getFloat64(at, true)],
};

// The rows of one loop or cell: its variables, and the newest row.
export class Rows {
  constructor(topic, schema) {
    this.topic = topic;
    this.view = null;
    this.variables = [];
    let labels = [], at = HEAD;
    for (const line of schema.split('\n').slice(3)) {
      const [, kind, name, comment] = line.match(/^(\w+) (\S+) # (.*)$/) ?? [];
      if (!(kind in KINDS)) continue;
      if (name.includes('=')) {
        labels.push(comment);
        continue;
      }
      const [size, read] = KINDS[kind];
      at = Math.ceil(at / size) * size;
      const [own, unit, about] = comment.split('\t');
      const place = at;
      const texts = labels;
      this.variables.push({
        name: own, unit, about, kind, rows: this,
        value: () => this.view && read(this.view, place),
        text(value) { return texts[value] ?? brief(value, kind); },
      });
      at += size;
      labels = [];
    }
    this.bytes = at;
  }

  take(view, at) {
    if (view.byteLength < HEADER + this.bytes) return;
    [this.view, this.at] = [new DataView(view.buffer, view.byteOffset + HEADER), at];
    this.came = performance.now();
  }
}

function brief(value, kind) {
  if (value === null) return '–';
  if (!kind.startsWith('float')) return String(value);
  if (!Number.isFinite(value)) return 'none';
  const size = Math.abs(value);
  return size === 0 || (size >= 1e-3 && size < 1e6) ? value.toFixed(size < 10 ? 4 : 2) : value.toExponential(3);
}

// Reads texts one after the other.
export class Texts {
  constructor(view, at) { [this.view, this.at] = [view, at]; }

  next() {
    this.at = Math.ceil((this.at - HEADER) / 4) * 4 + HEADER;
    const length = this.view.getUint32(this.at, true);
    const bytes = new Uint8Array(this.view.buffer, this.view.byteOffset + this.at + 4, length - 1);
    this.at += 4 + length;
    return new TextDecoder().decode(bytes);
  }
}
