// Makes an element of the page, with properties and children.
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// Returns whether a text contains all words that were written into a filter.
export function words(written) {
  const all = written.toLowerCase().split(/\s+/);
  return text => all.every(word => text.toLowerCase().includes(word));
}

// Returns a position with the digits that are shown, and written into a motion.
export function short(position) {
  return Number(position.toFixed(4));
}

// Shows a text if another one is shown.
export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

// Returns the colours of the style sheet in the present scheme.
export function color(name) {
  const probe = element('span', { hidden: true });
  probe.style.color = `var(--${name})`;
  document.body.append(probe);
  const found = getComputedStyle(probe).color;
  probe.remove();
  return found;
}

// Sizes a canvas to its place on the screen; returns its context, whose unit is a pixel of CSS.
export function fitted(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const scale = devicePixelRatio || 1;
  const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext('2d');
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}
