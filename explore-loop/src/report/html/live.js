// The moving model and the cloud, with the tools: frame by frame, played or by hand.

function liveView(root, whenTime) {
  const place = root.querySelector('.canvas');
  const slider = root.querySelector('.time');
  const play = root.querySelector('.play');
  const colour = root.querySelector('.colour');
  const clock = root.querySelector('.clock');
  const key = root.querySelector('.legend');
  const { frames, meshes, every } = DATA.live;
  if (frames.length === 0) {
    for (const control of root.querySelectorAll('select, .controls')) control.hidden = true;
    notice(place, 'No frame was processed.');
    return;
  }
  const some = frames.filter((_, i) => i % Math.ceil(frames.length / 12) === 0);
  const stage = new Stage(place, boxOf(some.map((frame) => points(frame.vertices))), 2.5);
  if (!stage.renderer) return;
  slider.max = String(frames.length - 1);
  const spacing = drawnSpacing(stage.box);
  table(stage, some);

  const known = frames.some((frame) => frame.error.data !== '');
  const MODES = ['first seen', 'seen now', ...(known ? ['distance to the true position'] : []), 'plain'];
  options(colour, MODES, 0);
  const latest = Math.max(0.1, frames[frames.length - 1].time);
  const highest = known ? percentile(frames, 0.98) : 1;

  function paints(frame, count) {
    const mode = MODES[Number(colour.value)];
    const keys = [['#9aa3af', 'points of the cloud']];
    if (mode === 'first seen') {
      legend(key, mode, 's', 'time', 0, latest, keys);
      return colours(values(frame.born).map(timeOfFrame), 'time', 0, latest);
    }
    if (mode === 'distance to the true position') {
      legend(key, mode, 'mm', 'bad', 0, highest, keys);
      const list = frame.error.data === '' ? new Float32Array(count).fill(NaN) : values(frame.error);
      return colours(list, 'bad', 0, highest);
    }
    const list = new Float32Array(3 * count);
    const seen = flags(frame.measured, count);
    const now = [new THREE.Color('#b98a6d'), new THREE.Color('#2f7f73')];
    for (let i = 0; i < count; i++) (mode === 'plain' ? PLAIN : now[Number(seen[i])]).toArray(list, 3 * i);
    legend(key, '', '', null, 0, 0, mode === 'plain' ? keys : [['#2f7f73', 'seen now'], ['#b98a6d', 'predicted'], ...keys]);
    return list;
  }

  function paint() {
    const at = Number(slider.value);
    const frame = frames[at];
    const positions = points(frame.vertices);
    const count = positions.length / 3;
    const shown = (name) => root.querySelector(`.${name}`).checked;
    const list = paints(frame, count);
    const parts = [];
    if (shown('mesh')) {
      const triangles = meshes[frame.mesh] ? indices(meshes[frame.mesh]) : new Uint16Array(0);
      if (triangles.every((i) => i < count)) parts.push(...surface(positions, triangles, list));
      // Vertices that were added after the mesh was computed.
      const meshed = new Uint8Array(count);
      for (const i of triangles) meshed[i] = 1;
      const bare = Array.from({ length: count }, (_, i) => i).filter((i) => !meshed[i]);
      const pick = (source) => new Float32Array(bare.flatMap((i) => [source[3 * i], source[3 * i + 1], source[3 * i + 2]]));
      if (bare.length > 0) parts.push(dots(pick(positions), 0.7 * spacing, 0xffffff, pick(list)));
    }
    stage.show('model', parts);
    stage.show('cloud', shown('cloud') ? [dots(points(frame.cloud), 0.34 * spacing, 0x59626e)] : []);
    stage.show('tools', shown('tools') ? frame.arms.map((arm, k) => tool(arm, armColour(k), spacing)) : []);
    stage.show('ways', shown('ways') ? ways(frame, spacing) : []);
    clock.textContent = `${frame.time.toFixed(1)} s, frame ${frame.frame}${frame.phase ? `, ${frame.phase}` : ''}`;
    whenTime(frame.time);
  }

  let playing = 0;
  function stop() {
    clearInterval(playing);
    playing = 0;
    play.textContent = 'play';
  }
  play.addEventListener('click', () => {
    if (playing) { stop(); return; }
    if (slider.value === slider.max) slider.value = '0';
    play.textContent = 'pause';
    // At three times the real speed, but no faster than can be drawn.
    const pace = Math.max(40, 1000 * latest / Math.max(1, frames.length - 1) / 3);
    playing = setInterval(() => {
      if (slider.value === slider.max) { stop(); return; }
      slider.value = String(Number(slider.value) + 1);
      paint();
    }, pace);
  });
  slider.addEventListener('input', () => { stop(); paint(); });
  colour.addEventListener('change', paint);
  for (const box of root.querySelectorAll('input[type="checkbox"]')) box.addEventListener('change', paint);
  root.querySelector('.reset').addEventListener('click', () => stage.aim());
  root.querySelector('h2').title = every > 1 ? `one frame of ${every}` : 'every frame';
  paint();
}

// The table below the object.
function table(stage, some) {
  const { offset } = DATA.about;
  if (new THREE.Vector3(...DATA.about.up).lengthSq() === 0) return;
  const [low, high] = boxOf(some.map((frame) => points(frame.vertices))).map((corner) => new THREE.Vector3(...corner));
  const centre = low.clone().add(high).multiplyScalar(0.5);
  const size = 0.05 * Math.ceil(2.2 * low.distanceTo(high) / 0.05);
  const grid = new THREE.GridHelper(size, Math.round(size / 0.05), 0xc3cad3, 0xdde1e6);
  grid.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), UP);
  // Half a millimetre lower, so that its lines do not cut the object lying on it.
  grid.position.copy(centre).addScaledVector(UP, -(UP.dot(centre) + offset) - 5e-4);
  stage.show('table', [grid]);
}

// A tool: a shaft that ends at the tip, and two fingers.
function tool(arm, colour, spacing) {
  const group = new THREE.Group();
  const along = new THREE.Vector3(...arm.along);
  const across = new THREE.Vector3(...arm.across);
  const tip = new THREE.Vector3(...arm.at);
  const material = new THREE.MeshLambertMaterial({ color: colour, transparent: !arm.holding, opacity: arm.holding ? 1 : 0.45 });
  const rod = (from, to, thick) => {
    const way = to.clone().sub(from);
    const mesh = new THREE.Mesh(new THREE.CylinderGeometry(thick, thick, way.length(), 14), material);
    mesh.position.copy(from).addScaledVector(way, 0.5);
    mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
    group.add(mesh);
  };
  const wrist = tip.clone().addScaledVector(along, -0.016);
  rod(tip.clone().addScaledVector(along, -0.11), wrist, 0.7 * spacing);
  const open = 0.004 + 0.5 * 0.016 * Math.sin(Math.max(0, Math.min(1.5, arm.jaw)));
  for (const side of [-1, 1]) rod(wrist, tip.clone().addScaledVector(across, side * open), 0.35 * spacing);
  return group;
}

// The planned paths of the tips in the manipulation of a frame (dashed), and their actual paths until then.
function ways(frame, spacing) {
  const manipulation = DATA.manipulations.find((m) => m.number === frame.manipulation);
  if (!manipulation) return [];
  const planned = manipulation.planned.map((path) => line(points(path.points), armColour(path.arm), { dashed: spacing }));
  const tips = manipulation.tips.filter((tip) => tip.time <= frame.time + 1e-6);
  const arms = tips.length > 0 ? tips[0].at.length : 0;
  const gone = Array.from({ length: arms }, (_, arm) => line(new Float32Array(tips.flatMap((tip) => tip.at[arm])), armColour(arm)));
  const grips = manipulation.grips.map((grip) => ball(grip.at, 0.6 * spacing, armColour(grip.arm)));
  return [...planned, ...gone, ...grips];
}

// The value that this share of the errors of some frames does not exceed.
function percentile(frames, share) {
  const all = [];
  for (let i = 0; i < frames.length; i += Math.ceil(frames.length / 20)) {
    if (frames[i].error.data !== '') all.push(...values(frames[i].error).filter(Number.isFinite));
  }
  all.sort((a, b) => a - b);
  return all.length > 0 ? Math.max(0.1, all[Math.floor(share * (all.length - 1))]) : 1;
}
