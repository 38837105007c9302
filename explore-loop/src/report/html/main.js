// Fills the page.

function closing(root) {
  for (const [name, value] of TIMES.rows) {
    const row = element('tr');
    row.append(element('th', name, { scope: 'row' }), element('td', value));
    root.append(row);
  }
}

function manipulations(root) {
  if (DATA.manipulations.length === 0) { root.hidden = true; return; }
  const table = root.querySelector('table');
  const head = element('tr');
  for (const name of ['', 'begins, s', 'action', 'arms', 'coverage', 'score', 'largest speed, mm/s', 'motion, s']) head.append(element('th', name));
  const top = element('thead');
  top.append(head);
  table.append(top);
  for (const m of DATA.manipulations) {
    const row = element('tr');
    const arms = m.grips.map((g) => `${DATA.about.arms[g.arm] ?? g.arm} ${g.lifts ? 'lifts' : 'supports'}`).join(', ');
    for (const cell of [String(m.number), m.time.toFixed(1), m.what.split(':')[0], arms, number(m.coverage, 2), number(m.score, 2), number(1e3 * m.speed_limit), m.duration.toFixed(1)]) {
      row.append(element('td', cell));
    }
    table.append(row);
  }
}

function notes(root) {
  const list = DATA.notes.map(([time, text]) => `${time.toFixed(1)} s: ${text}`);
  if (DATA.more_notes > 0) list.push(`and ${DATA.more_notes} more`);
  const { every } = DATA.live;
  if (every > 1) list.unshift(`The live view shows one frame of ${every}, so that this page stays small.`);
  if (DATA.samples.every > 1) list.unshift(`The curves show one frame of ${DATA.samples.every}.`);
  root.hidden = list.length === 0;
  root.querySelector('ul').append(...list.map((text) => element('li', text)));
}

function header() {
  const { metrics } = TIMES;
  const { about } = DATA;
  document.getElementById('title').textContent = about.subject || 'Exploration';
  const spacing = `${Number((1e3 * about.spacing).toPrecision(3))} mm spacing`;
  const parts = [
    metrics.stop ? metrics.stop.replaceAll('_', ' ') : '',
    metrics.grips === 'recorded' ? 'from a recording' : `seed ${metrics.seed ?? '–'}`,
    `${metrics.arms ?? about.arms.length} arms`,
    spacing,
  ];
  document.getElementById('summary').textContent = parts.filter(Boolean).join(' · ');
  document.getElementById('command').textContent = about.command;
  document.getElementById('version').textContent = `explore ${about.version}`;
  document.getElementById('metrics').textContent = JSON.stringify(metrics, null, 2);
}

header();
closing(document.getElementById('closing'));
const moveMark = curves(document.getElementById('curves'));
restView(document.getElementById('rest'));
liveView(document.getElementById('live'), moveMark);
const homology = document.getElementById('homology');
homology.hidden = DATA.decisions.length === 0;
homology.querySelector('.barcodes').append(...DATA.decisions.map((d, i) => barcode(d, i === DATA.decisions.length - 1 ? 'At the end' : `Before manipulation ${d.manipulations + 1}`)));
manipulations(document.getElementById('manipulations'));
notes(document.getElementById('notes'));
document.documentElement.dataset.ready = 'yes';
