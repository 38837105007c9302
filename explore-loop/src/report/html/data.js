// The data of the page, and the arrays packed in them.

const DATA = JSON.parse(document.getElementById('data').textContent);
const TIMES = JSON.parse(document.getElementById('times').textContent);

function bytes(text) {
  const raw = atob(text);
  const out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out;
}

const words = (text) => new Uint16Array(bytes(text).buffer);

// Positions, three numbers each, in metres.
function points(packed) {
  const levels = words(packed.data);
  const out = new Float32Array(levels.length);
  for (let i = 0; i < levels.length; i++) out[i] = packed.low[i % 3] + packed.step[i % 3] * levels[i];
  return out;
}

// Values; NaN where they are unknown.
function values(packed) {
  const levels = words(packed.data);
  const out = new Float32Array(levels.length);
  for (let i = 0; i < levels.length; i++) out[i] = levels[i] === 65535 ? NaN : packed.low + packed.step * levels[i];
  return out;
}

function indices(packed) {
  const raw = bytes(packed.data).buffer;
  return packed.wide ? new Uint32Array(raw) : new Uint16Array(raw);
}

function flags(text, count) {
  const raw = bytes(text);
  return Array.from({ length: count }, (_, i) => ((raw[i >> 3] >> (i & 7)) & 1) === 1);
}

// Time of a frame, from the frames in the curves.
function timeOfFrame(frame) {
  const { frame: frames, time } = DATA.samples;
  if (!(frame >= 0) || frames.length === 0) return NaN;
  let low = 0;
  let high = frames.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (frames[middle] <= frame) low = middle; else high = middle - 1;
  }
  const next = low + 1;
  if (next >= frames.length || frames[next] === frames[low]) return time[low];
  const share = Math.max(0, (frame - frames[low]) / (frames[next] - frames[low]));
  return time[low] + share * (time[next] - time[low]);
}

// An element with text in it; text is never parsed as markup.
function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  if (value === 0) return '0';
  const places = Math.max(0, Math.min(4, digits - 1 - Math.floor(Math.log10(Math.abs(value)))));
  return value.toFixed(places);
}
