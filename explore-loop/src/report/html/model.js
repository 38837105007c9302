// The model at rest before each decision: its coloured mesh, its boundary loops, and the selected grips.

// The colour scale of a quantity, by the beginning of its name; the default is the scale of time.
const STYLES = [
  ['first seen', 'time'],
  ['confidence', 'good'],
  ['distance', 'bad'],
];

function styleOf(name) {
  const found = STYLES.find(([start]) => name.startsWith(start));
  return found ? found[1] : 'time';
}

const RIM = '#8d1230';
const LOOP = '#e0259a';

const SEEN = 'colour as seen';

// Colours of the screen, three bytes each, in the order of the renderer.
function seenColours(raw) {
  const out = new Float32Array(raw.length);
  const made = new THREE.Color();
  for (let i = 0; i < raw.length; i += 3) made.setRGB(raw[i] / 255, raw[i + 1] / 255, raw[i + 2] / 255, 'srgb').toArray(out, i);
  return out;
}

// The edges of only one triangle, as pairs of positions.
function openEdges(positions, triangles) {
  const count = positions.length / 3;
  const once = new Map();
  for (let i = 0; i < triangles.length; i++) {
    const a = triangles[i];
    const b = triangles[i % 3 === 2 ? i - 2 : i + 1];
    const edge = Math.min(a, b) * count + Math.max(a, b);
    if (once.has(edge)) once.delete(edge); else once.set(edge, [a, b]);
  }
  return new Float32Array([...once.values()].flat().flatMap((v) => [...positions.subarray(3 * v, 3 * v + 3)]));
}

function restView(root) {
  const place = root.querySelector('.canvas');
  const when = root.querySelector('.when');
  const colour = root.querySelector('.colour');
  const key = root.querySelector('.legend');
  const decisions = DATA.decisions;
  const last = decisions.length - 1;
  if (last < 0 || decisions[last].mesh.vertices.data === '') {
    for (const control of root.querySelectorAll('select, .controls')) control.hidden = true;
    notice(place, 'No surface was known when the run ended.');
    if (last < 0) return;
  }
  const final = points(decisions[last].mesh.vertices);
  const corners = [...new Set(indices(decisions[last].mesh.triangles))];
  const stage = new Stage(place, boxOf([corners.flatMap((v) => [...final.subarray(3 * v, 3 * v + 3)])]));
  if (!stage.renderer) return;
  options(when, decisions.map((d, i) => (i === last ? 'at the end' : `before manipulation ${d.manipulations + 1}`)), last);

  // Names of the quantities of a decision; then the colours of the camera, if there are any, and the plain surface.
  const names = (decision) => [...decision.mesh.quantities.map((q) => q.name), ...(decision.mesh.colours === '' ? [] : [SEEN]), 'plain'];
  options(colour, names(decisions[last]), 0);

  function paint() {
    const decision = decisions[Number(when.value)];
    const positions = points(decision.mesh.vertices);
    const quantity = decision.mesh.quantities[Number(colour.value)];
    const keys = [['#cd786e', 'inner side']];
    const shows = root.querySelector('.holes').checked;
    const loops = shows ? decision.loops : [];
    const rim = shows ? openEdges(positions, indices(decision.mesh.triangles)) : [];
    if (rim.length > 0) keys.push([RIM, 'open edges']);
    if (loops.length > 0) keys.push([LOOP, `boundary loops of the complex (${loops.length})`]);
    let paints;
    if (quantity) {
      let list = values(quantity.values);
      if (quantity.name === 'first seen') list = list.map(timeOfFrame);
      // Vertices without a triangle are not drawn and not counted.
      const used = new Set(indices(decision.mesh.triangles));
      let [low, high] = range(list.map((value, v) => (used.has(v) ? value : NaN)));
      if (styleOf(quantity.name) === 'bad') low = 0;
      if (quantity.name === 'confidence') [low, high] = [0, 1];
      paints = colours(list, styleOf(quantity.name), low, high);
      legend(key, quantity.name, quantity.unit, styleOf(quantity.name), low, high, keys);
    } else if (colour.selectedOptions[0]?.textContent === SEEN) {
      paints = seenColours(bytes(decision.mesh.colours));
      legend(key, '', '', null, 0, 0, [['#808080', 'no colour known'], ...keys]);
    } else {
      paints = new Float32Array(positions.length);
      for (let i = 0; i < positions.length; i += 3) PLAIN.toArray(paints, i);
      legend(key, '', '', null, 0, 0, keys);
    }
    stage.show('mesh', surface(positions, indices(decision.mesh.triangles), paints));
    stage.show('loops', [
      ...(rim.length > 0 ? [line(rim, RIM, { pieces: true })] : []),
      ...loops.map((loop) => line(points(loop), LOOP, { closed: true })),
    ]);

    // The grips of the next manipulation; at the end those of the last one.
    const shown = root.querySelector('.grips').checked
      ? DATA.manipulations.filter((m) => m.number === decision.manipulations + 1 || (decision === decisions[last] && m.number === decision.manipulations))
      : [];
    const size = 0.9 * drawnSpacing(stage.box);
    stage.show('grips', shown.flatMap((m) => m.grips.filter((g) => g.rest).map((g) => ball(g.rest, size, armColour(g.arm)))));
  }

  when.addEventListener('change', () => {
    const chosen = colour.selectedOptions[0]?.textContent;
    const list = names(decisions[Number(when.value)]);
    options(colour, list, Math.max(0, list.indexOf(chosen)));
    paint();
  });
  colour.addEventListener('change', paint);
  for (const box of root.querySelectorAll('input[type="checkbox"]')) box.addEventListener('change', paint);
  root.querySelector('.reset').addEventListener('click', () => stage.aim());
  paint();
}
