// The haptic loop: a worker in which pandis.h keeps a probe out of an object, at a thousand ticks per
// second. It receives the module, fields and targets as messages, and reports its state about sixty
// times per second.
"use strict";

const TICK = 1, MOST = 64, EVERY = 15, KEPT = 4096; // ms per tick, ticks at once, ms between reports, times stored
const TARGET = 0, SIZE = 3, STIFFNESS = 4, FRICTION = 5, RADIUS = 6, PROBE = 8, PROXY = 11, FORCE = 14, NORMAL = 17,
  DEPTH = 20, STATE = 21, TICKS = 32;

let pandis, numbers, running = false, last = 0, told = 0, forces = [];
const times = new Float32Array(KEPT); // ms per tick, for each batch
let timed = 0, spent = 0, ticks = 0, shown = true, posted = false;
const channel = new MessageChannel();

function array() {
  const at = pandis.web_numbers();
  return new Float64Array(pandis.memory.buffer, at, TICKS + MOST);
}

function open(bytes, settings) {
  running = false;
  const at = pandis.web_room(bytes.byteLength);
  if (!at) return "there is not enough memory for this file";
  new Uint8Array(pandis.memory.buffer, at, bytes.byteLength).set(new Uint8Array(bytes));
  numbers = array(); // growing the memory detaches the previous array
  let error = pandis.web_open(at, bytes.byteLength);
  if (!error) {
    Object.entries({ [SIZE]: settings.size, [RADIUS]: 0 }).forEach(([k, value]) => (numbers[k] = value));
    set(settings);
    numbers.set(settings.target, TARGET);
    numbers.fill(0, FORCE, FORCE + 3);
    error = pandis.web_begin();
  }
  return error ? textAt(pandis.web_error(error)) : "";
}

function textAt(at) {
  const bytes = new Uint8Array(pandis.memory.buffer, at);
  return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
}

function set(settings) {
  if (settings.stiffness !== undefined) numbers[STIFFNESS] = settings.stiffness;
  if (settings.friction !== undefined) numbers[FRICTION] = settings.friction;
}

function percentile(share) {
  const kept = times.slice(0, Math.min(timed, KEPT)).sort();
  return kept.length ? kept[Math.min(kept.length - 1, Math.floor(share * kept.length))] : 0;
}

function tell() {
  const part = (at) => Array.from(numbers.subarray(at, at + 3));
  postMessage({
    probe: part(PROBE), proxy: part(PROXY), force: part(FORCE), normal: part(NORMAL), depth: numbers[DEPTH],
    state: numbers[STATE], forces: Float32Array.from(forces), ticks,
    mean: spent / Math.max(ticks, 1), slow: percentile(0.99), slowest: percentile(1), // a page's clock is coarse
  });
  forces = [];
}

function step() {
  if (!running || !shown) return;
  const now = performance.now();
  let due = Math.floor((now - last) / TICK);
  if (due > 4 * MOST) last = now - MOST * TICK, due = MOST; // the page was asleep
  for (; due > 0; due -= MOST) {
    const count = Math.min(due, MOST), begin = performance.now();
    pandis.web_ticks(count);
    const took = performance.now() - begin;
    times[timed++ % KEPT] = took / count;
    spent += took;
    ticks += count;
    for (let i = 0; i < count; i++) forces.push(numbers[TICKS + i]);
    last += count * TICK;
  }
  if (now - told > EVERY) {
    told = now;
    tell();
  }
  next();
}

// Continue while the loop runs and is visible, with at most one message in flight.
function next() {
  if (!running || !shown || posted) return;
  posted = true;
  channel.port2.postMessage(0);
}

channel.port1.onmessage = () => {
  posted = false;
  step();
};
onmessage = async ({ data }) => {
  if (data.wasm) {
    const own = { env: { sin: Math.sin, cos: Math.cos, atan2: Math.atan2 } };
    pandis = (await WebAssembly.instantiate(data.wasm, own)).instance.exports;
    postMessage({ ready: true });
  } else if (data.bytes) {
    const error = open(data.bytes, data.settings);
    running = !error;
    timed = spent = ticks = 0;
    last = performance.now();
    postMessage({ opened: data.name, error });
    next();
  } else if (data.shown !== undefined) {
    shown = data.shown;
    last = performance.now();
    next();
  } else if (pandis && numbers) {
    if (data.target) numbers.set(data.target, TARGET);
    set(data);
  }
};
