// A stage: a scene whose camera is turned with the mouse, drawn only when something has changed; colours and their legends.

const INSIDE = 0xcd786e;
const ARMS = ['#d1602a', '#1f8a70', '#8a4fb0', '#a8842c'];
const armColour = (arm) => ARMS[arm % ARMS.length];

// Colours from low to high.
const RAMPS = {
  time: ['#3c6ec8', '#8fa0a8', '#fac83c'],
  good: ['#b5483a', '#eed9a6', '#2f7f73'],
  bad: ['#2f7f73', '#eed9a6', '#b5483a'],
};
const UNKNOWN = new THREE.Color('#b9bfc8');
const PLAIN = new THREE.Color('#c9a58f');

function ramp(name, share) {
  const stops = RAMPS[name];
  const at = Math.min(1, Math.max(0, share)) * (stops.length - 1);
  const k = Math.min(stops.length - 2, Math.floor(at));
  return new THREE.Color(stops[k]).lerp(new THREE.Color(stops[k + 1]), at - k);
}

// A colour for each value, from a table, so that thousands of colours need not be created.
function colours(list, rampName, low, high) {
  const table = Array.from({ length: 256 }, (_, i) => ramp(rampName, i / 255));
  const out = new Float32Array(3 * list.length);
  list.forEach((value, i) => {
    const share = high > low ? (value - low) / (high - low) : 0;
    const colour = Number.isFinite(value) ? table[Math.round(255 * Math.min(1, Math.max(0, share)))] : UNKNOWN;
    colour.toArray(out, 3 * i);
  });
  return out;
}

function range(list) {
  let low = Infinity;
  let high = -Infinity;
  for (const value of list) {
    if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
  }
  return low <= high ? [low, high] : [0, 1];
}

function legend(place, name, unit, rampName, low, high, keys = []) {
  place.replaceChildren();
  if (rampName) {
    place.append(element('div', unit ? `${name}, ${unit}` : name));
    place.append(element('div', '', { class: 'ramp', style: `background: linear-gradient(to right, ${RAMPS[rampName].join(', ')})` }));
    const ends = element('div', undefined, { class: 'ends' });
    ends.append(element('span', number(low)), element('span', number(high)));
    place.append(ends);
  }
  if (keys.length > 0) {
    const line = element('div', undefined, { class: 'keys' });
    for (const [colour, text] of keys) {
      const item = element('span', undefined, { class: 'item' });
      item.append(element('span', '', { class: 'key', style: `background: ${colour}` }), text);
      line.append(item);
    }
    place.append(line);
  }
}

const UP = (() => {
  const up = new THREE.Vector3(...DATA.about.up);
  return up.lengthSq() > 0 ? up.normalize() : new THREE.Vector3(0, 0, 1);
})();

class Stage {
  // `box`: low and high corner of the region to show first.
  constructor(place, box, distance = 3.0) {
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.001, 20);
    this.camera.up.copy(UP);
    this.canvas = document.createElement('canvas');
    place.append(this.canvas);
    try {
      this.renderer = new THREE.WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    } catch {
      this.canvas.remove();
      place.append(element('p', 'This browser has no WebGL, so the three-dimensional view cannot be drawn.', { class: 'notice' }));
      return;
    }
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0xb8b0a8, 1.5));
    const sun = new THREE.DirectionalLight(0xffffff, 1.9);
    sun.position.set(-0.5, 0.9, 1);
    this.camera.add(sun);
    this.scene.add(this.camera);
    this.controls = new THREE.OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener('change', () => this.draw());
    this.box = box;
    this.distance = distance;
    this.aim();
    new ResizeObserver(() => this.resize(place)).observe(place);
    this.resize(place);
  }

  // The initial view is obliquely from above, from the side of the cell's camera.
  aim() {
    const [low, high] = this.box.map((corner) => new THREE.Vector3(...corner));
    const centre = low.clone().add(high).multiplyScalar(0.5);
    const radius = Math.max(0.02, 0.5 * high.distanceTo(low));
    let side = centre.clone().negate();
    side.addScaledVector(UP, -side.dot(UP));
    if (side.length() < 0.3 * centre.length() || side.lengthSq() === 0) {
      // The camera looks straight down: use the lower edge of its images.
      side = new THREE.Vector3(0, 1, 0);
      side.addScaledVector(UP, -side.dot(UP));
      if (side.lengthSq() < 1e-6) side = new THREE.Vector3(1, 0, 0);
    }
    const away = side.normalize().addScaledVector(UP, 0.75).normalize();
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(away, this.distance * radius);
    this.camera.near = 0.02 * radius;
    this.camera.far = 60 * radius;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }

  resize(place) {
    const { clientWidth: width, clientHeight: height } = place;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    if (!this.renderer || this.asked) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      this.renderer.render(this.scene, this.camera);
    });
  }

  // Replaces the parts shown under a name.
  show(name, parts) {
    const old = this.scene.getObjectByName(name);
    if (old) {
      old.traverse((part) => { part.geometry?.dispose(); part.material?.dispose?.(); });
      this.scene.remove(old);
    }
    const group = new THREE.Group();
    group.name = name;
    if (parts.length > 0) group.add(...parts);
    this.scene.add(group);
    this.draw();
  }
}

// A surface with its outer side in the given colours and its inner side in one, so that a hole shows as a change of colour.
function surface(positions, triangles, colour) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute('color', new THREE.BufferAttribute(colour, 3));
  geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
  geometry.computeVertexNormals();
  const outside = new THREE.MeshLambertMaterial({ vertexColors: true, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
  const inside = new THREE.MeshLambertMaterial({ color: INSIDE, side: THREE.BackSide });
  return [new THREE.Mesh(geometry, outside), new THREE.Mesh(geometry, inside)];
}

function dots(positions, size, colour, colourList) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
  if (colourList) geometry.setAttribute('color', new THREE.BufferAttribute(colourList, 3));
  return new THREE.Points(geometry, new THREE.PointsMaterial({ size, color: colour, vertexColors: Boolean(colourList), sizeAttenuation: true }));
}

function line(positions, colour, { closed = false, pieces = false, dashed = 0 } = {}) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
  const material = dashed > 0
    ? new THREE.LineDashedMaterial({ color: colour, dashSize: dashed, gapSize: dashed })
    : new THREE.LineBasicMaterial({ color: colour });
  const Kind = closed ? THREE.LineLoop : pieces ? THREE.LineSegments : THREE.Line;
  const made = new Kind(geometry, material);
  if (dashed > 0) made.computeLineDistances();
  return made;
}

function ball(at, radius, colour) {
  const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 20, 14), new THREE.MeshLambertMaterial({ color: colour }));
  mesh.position.set(...at);
  return mesh;
}

// The spacing of the model as a unit of length for drawing; for a coarse model a share of its size.
function drawnSpacing([low, high]) {
  return Math.min(DATA.about.spacing, 0.025 * Math.hypot(...low.map((c, k) => high[k] - c)));
}

// The bounding box of positions.
function boxOf(list) {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const positions of list) {
    for (let i = 0; i < positions.length; i++) {
      low[i % 3] = Math.min(low[i % 3], positions[i]);
      high[i % 3] = Math.max(high[i % 3], positions[i]);
    }
  }
  return low[0] <= high[0] ? [low, high] : [[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]];
}

function options(select, names, chosen) {
  select.replaceChildren(...names.map((name, i) => element('option', name, { value: String(i) })));
  select.value = String(Math.max(0, Math.min(names.length - 1, chosen)));
  select.hidden = names.length < 2;
}

function notice(place, text) {
  place.append(element('p', text, { class: 'notice' }));
}
