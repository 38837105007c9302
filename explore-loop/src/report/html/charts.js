// Curves and barcodes, drawn as SVG.

const INKS = ['#2b62c0', '#d1602a', '#1f8a70', '#8a4fb0'];
const WIDE = 300;
const HIGH = 150;
const PAD = { left: 36, right: 8, top: 6, bottom: 30 };

function svg(name, attributes = {}, text) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, typeof value === 'number' ? String(Math.round(100 * value) / 100) : value);
  if (text !== undefined) made.textContent = text;
  return made;
}

// Round numbers over a range, about as many as requested.
function ticks(low, high, count) {
  const raw = (high - low) / count;
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * unit).find((k) => k >= raw);
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) out.push(k * step);
  return { out, step };
}

const tickText = (value, step) => value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));

// Draws axes with their numbers; returns the scales.
function axes(root, [x0, x1], [y0, y1], unitX, whole, high = HIGH) {
  const x = (value) => PAD.left + ((value - x0) / (x1 - x0)) * (WIDE - PAD.left - PAD.right);
  const y = (value) => high - PAD.bottom - ((value - y0) / (y1 - y0)) * (high - PAD.top - PAD.bottom);
  if (whole !== null) {
    const { out, step } = ticks(y0, y1, 4);
    for (const value of out.filter((v) => !whole || Number.isInteger(v))) {
      root.append(svg('line', { class: 'grid', x1: PAD.left, x2: WIDE - PAD.right, y1: y(value), y2: y(value) }));
      root.append(svg('text', { x: PAD.left - 5, y: y(value) + 3.5, 'text-anchor': 'end' }, tickText(value, whole ? 1 : step)));
    }
  }
  root.append(svg('line', { class: 'axis', x1: PAD.left, x2: WIDE - PAD.right, y1: high - PAD.bottom, y2: high - PAD.bottom }));
  const { out, step } = ticks(x0, x1, 5);
  for (const value of out) root.append(svg('text', { x: x(value), y: high - PAD.bottom + 13, 'text-anchor': 'middle' }, tickText(value, step)));
  root.append(svg('text', { x: (PAD.left + WIDE - PAD.right) / 2, y: high - 3, 'text-anchor': 'middle' }, unitX));
  return { x, y };
}

// Reduces a curve to the resolution of the screen: the lowest and the highest point of each pixel column.
function slim(xs, ys) {
  const most = 2 * WIDE;
  if (xs.length <= most) return xs.map((_, i) => i);
  const chosen = new Set([0, xs.length - 1]);
  const per = Math.ceil(xs.length / WIDE);
  for (let from = 0; from < xs.length; from += per) {
    let low = -1;
    let high = -1;
    for (let i = from; i < Math.min(xs.length, from + per); i++) {
      if (!Number.isFinite(ys[i])) continue;
      if (low < 0 || ys[i] < ys[low]) low = i;
      if (high < 0 || ys[i] > ys[high]) high = i;
    }
    if (low >= 0) { chosen.add(low); chosen.add(high); }
  }
  return [...chosen].sort((a, b) => a - b);
}

// A chart of curves over time: `curves` have a name, `x`, `y`; `marks` also draws their points, `whole` shows only whole numbers.
function chart(name, unit, curves, { marks = false, whole = false, top = 0 } = {}) {
  const shown = curves
    .map((curve, k) => ({ ...curve, ink: INKS[k], y: curve.y.map((v) => (v === null || v === undefined ? NaN : v)) }))
    .filter((curve) => curve.y.some(Number.isFinite));
  if (shown.length === 0) return null;
  const box = element('div', undefined, { class: 'chart' });
  const heading = element('h3', name);
  if (unit) heading.append(' ', element('small', unit));
  const [, x1] = range(shown.flatMap((curve) => curve.x));
  let high = top;
  for (const curve of shown) high = Math.max(high, range(curve.y)[1]);
  const root = svg('svg', { viewBox: `0 0 ${WIDE} ${HIGH}`, role: 'img', 'aria-label': name });
  const last = Math.max(x1, DATA.samples.time[DATA.samples.time.length - 1] ?? 0, 1);
  const { x, y } = axes(root, [0, last], [0, high > 0 ? (top && high <= top ? top : 1.06 * high) : 1], 'time, s', whole);
  for (const curve of shown) {
    // A single point makes no line.
    const dots = marks || curve.y.filter(Number.isFinite).length === 1;
    let path = '';
    let pen = 'M';
    for (const i of slim(curve.x, curve.y)) {
      if (!Number.isFinite(curve.y[i])) { pen = 'M'; continue; }
      path += `${pen}${x(curve.x[i]).toFixed(1)} ${y(curve.y[i]).toFixed(1)}`;
      pen = 'L';
      if (dots) root.append(svg('circle', { cx: x(curve.x[i]), cy: y(curve.y[i]), r: 2.6, fill: curve.ink }));
    }
    root.append(svg('path', { d: path, fill: 'none', stroke: curve.ink, 'stroke-width': 1.4, 'stroke-linejoin': 'round', class: 'curve' }));
  }
  const now = svg('line', { class: 'now', x1: x(0), x2: x(0), y1: PAD.top, y2: HIGH - PAD.bottom });
  root.append(now);
  box.append(heading, root);
  if (shown.length > 1 || shown[0].name) {
    const keys = element('div', undefined, { class: 'keys' });
    for (const curve of shown) {
      const item = element('span', undefined, { class: 'item' });
      item.append(element('span', '', { class: 'key', style: `background: ${curve.ink}` }), curve.name);
      keys.append(item);
    }
    box.append(keys);
  }
  return { box, at: (time) => { now.setAttribute('x1', x(time)); now.setAttribute('x2', x(time)); } };
}

// Draws all curves that have data; returns the functions that move their time marks.
function curves(root) {
  const { decisions, samples } = DATA;
  const when = decisions.map((d) => d.time);
  const each = (get) => decisions.map(get);
  const share = (value) => (value === null ? null : 100 * value);
  const mm = (pair, k) => (pair === null ? null : 1e3 * pair[k]);
  const frames = (name, list) => ({ name, x: samples.time, y: list });
  const steps = (name, y) => ({ name, x: when, y });
  const charts = [
    chart('Explored', '% of the true surface', [
      steps('within one spacing', each((d) => share(d.explored))),
      steps('within two spacings', each((d) => share(d.explored_2eps))),
    ], { marks: true, top: 100 }),
    chart('Accuracy and completeness', 'mm', [
      steps('accuracy, mean', each((d) => mm(d.accuracy, 0))),
      steps('completeness, mean', each((d) => mm(d.completeness, 0))),
      steps('accuracy, 95 %', each((d) => mm(d.accuracy, 1))),
      steps('completeness, 95 %', each((d) => mm(d.completeness, 1))),
    ], { marks: true }),
    chart('Persistent Betti numbers', '', [0, 1, 2].map((k) => steps(['β₀ components', 'β₁ loops', 'β₂ cavities'][k], each((d) => d.persistent[k]))), { marks: true, whole: true, top: 2 }),
    chart('Open surface', '% before a decision', [
      steps('on a boundary', each((d) => share(d.boundary))),
      steps('missing vector area', each((d) => share(d.missing))),
      steps('bare', each((d) => share(Math.max(0, d.bare)))),
    ], { marks: true }),
    chart('Error of the live model', 'mm', [frames('hidden: prediction', samples.hidden_error_mm), frames('seen', samples.seen_error_mm)]),
    chart('Distance to the cloud', 'mm', [frames('', samples.residual_mm)]),
    chart('Vertices', '', [frames('of the model', samples.vertices), frames('measured', samples.measured)]),
    chart('Time of a frame', 'ms', [frames('whole', TIMES.frame_ms), frames('registration', TIMES.registration_ms)]),
  ].filter(Boolean);
  root.append(...charts.map((c) => c.box));
  return (time) => charts.forEach((c) => c.at(time));
}

// The bars of a decision: the longest ones of each dimension, the longest at the bottom.
function barcode(decision, name) {
  const box = element('div', undefined, { class: 'barcode' });
  const heading = element('h3', name);
  heading.append(' ', element('small', `persistent Betti numbers ${decision.persistent.join(', ')}${decision.obstacle ? `; not closed: ${decision.obstacle}` : '; closed'}`));
  const ends = decision.bars.flatMap((d) => d.bars.flatMap(([birth, death]) => [birth, death ?? birth]));
  const last = Math.max(1.25, ...ends) * 1.04;
  // At most a dozen of each dimension: short bars are noise.
  const shown = decision.bars.map((d) => d.bars.slice(0, 12));
  const rows = shown.reduce((sum, bars) => sum + bars.length, 0);
  const row = rows > 24 ? 4 : 6;
  const high = PAD.top + PAD.bottom + row * rows + 10 * shown.filter((b) => b.length > 0).length;
  const root = svg('svg', { viewBox: `0 0 ${WIDE} ${high}`, role: 'img', 'aria-label': `barcode, ${name}` });
  const { x } = axes(root, [0, last], [0, 1], 'scale', null, high);
  let y = PAD.top;
  shown.forEach((bars, dimension) => {
    if (bars.length === 0) return;
    root.append(svg('text', { x: 2, y: y + row + 3 }, `H${'₀₁₂'[dimension]}`));
    for (const [birth, death] of bars) {
      root.append(svg('line', { class: 'bar', x1: x(birth), x2: x(death ?? last), y1: y + row / 2, y2: y + row / 2, stroke: INKS[dimension], 'stroke-width': row - 2 }));
      y += row;
    }
    y += 10;
  });
  for (const scale of [1, 1.25]) root.append(svg('line', { x1: x(scale), x2: x(scale), y1: 0, y2: high - PAD.bottom, stroke: '#1c2430', 'stroke-width': 0.8, 'stroke-dasharray': '3 3' }));
  box.append(heading, root);
  const more = decision.bars.map((d, k) => d.shorter + d.bars.length - shown[k].length);
  if (more.some((n) => n > 0)) box.append(element('div', `shorter bars, not drawn: ${more.map((n, k) => `${n} of H${'₀₁₂'[k]}`).join(', ')}`, { class: 'keys' }));
  return box;
}
