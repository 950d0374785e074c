// What pandis.wasm answers: node web.mjs MODULE FIELD POINTS ANSWERS, all of them files.
import { readFileSync, writeFileSync } from "node:fs";

const [module, file, points, answers] = process.argv.slice(2);
const own = { env: { sin: Math.sin, cos: Math.cos, atan2: Math.atan2 } };
const { exports: web } = (await WebAssembly.instantiate(readFileSync(module), own)).instance;
const bytes = readFileSync(file), at = web.web_room(bytes.length + 8 + readFileSync(points).length * 3);
new Uint8Array(web.memory.buffer, at, bytes.length).set(bytes);
const error = web.web_open(at, bytes.length);
if (error) {
  const text = new Uint8Array(web.memory.buffer, web.web_error(error));
  console.log(new TextDecoder().decode(text.subarray(0, text.indexOf(0))));
  process.exit(1);
}
const asked = readFileSync(points), count = asked.length / 24;
const first = (at + bytes.length + 7) & ~7, distances = first + 24 * count, normals = distances + 8 * count;
const flags = normals + 24 * count;
new Uint8Array(web.memory.buffer, first, asked.length).set(asked);
web.web_query(first, count, distances, normals, flags);
// then a probe that a hand leads along the first points, in metres, 8 ticks each
const numbers = new Float64Array(web.memory.buffer, web.web_numbers(), 96), ways = Math.min(count, 100);
const target = (i) => [0, 1, 2].map((k) => new Float64Array(web.memory.buffer, first, 3 * count)[3 * i + k]);
const [SIZE, STIFFNESS, FRICTION, RADIUS, PROBE, TICKS] = [3, 4, 5, 6, 8, 32], felt = [];
[numbers[SIZE], numbers[STIFFNESS], numbers[FRICTION], numbers[RADIUS]] = [0.1, 400, 0.3, 0];
numbers.set([1, 1, 1]);
numbers.fill(0, 14, 17);
const none = web.web_begin();
for (let i = 0; i < ways && !none; i++) {
  numbers.set(target(i).map((c) => 0.05 * c));
  web.web_ticks(8);
  felt.push(...numbers.subarray(PROBE, PROBE + 12), ...numbers.subarray(TICKS, TICKS + 8));
}
writeFileSync(answers, Buffer.concat([
  Buffer.from(web.memory.buffer, distances, 33 * count), Buffer.from(Float64Array.from(felt).buffer)]));
