// A page for touching an object: the pointer is a hand that holds a probe by a spring.
"use strict";

const SPAN = 3000; // ticks that the plot shows
const HOVER = 0.03, ARROW = 0.25; // unit-frame lengths: height above the surface; arrow per newton
const TOUCHING = 1, STICKING = 2;

class Touch extends Solid {
  constructor(page, held) {
    super(page.querySelector("canvas.object"), held);
    this.page = page;
    this.held = held;
    this.plot = page.querySelector("canvas.plot").getContext("2d");
    this.select = page.querySelector("select");
    for (const { name } of held.fields) this.select.add(new Option(name));
    this.metre = held.size / held.longest; // metres per unit-frame length
    this.forces = new Float32Array(SPAN);
    this.count = 0;
    this.inputs = Object.fromEntries([...page.querySelectorAll("input")].map((input) => [input.name, input]));
    this.worker = new Worker(URL.createObjectURL(new Blob([held.loop], { type: "text/javascript" })));
    this.worker.onmessage = ({ data }) => this.hear(data);
    this.worker.onerror = (event) => this.say(`The loop could not start: ${event.message}`);
    this.worker.postMessage({ wasm: decode(held.wasm, Uint8Array).buffer });
    this.listen();
    this.draw();
  }

  listen() {
    const canvas = this.canvas;
    this.steer();
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      canvas.focus();
      this.turning = event.button !== 0 || event.shiftKey ? [event.clientX, event.clientY] : null;
      this.pressing = !this.turning;
      this.point(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.turning) {
        this.turn(event.clientX - this.turning[0], event.clientY - this.turning[1]);
        this.turning = [event.clientX, event.clientY];
      } else this.point(event);
    });
    for (const end of ["pointerup", "pointercancel"])
      canvas.addEventListener(end, (event) => {
        this.turning = null;
        this.pressing = false;
        this.point(event);
      });
    canvas.addEventListener("wheel", (event) => {
      // on a page of many objects, the wheel scrolls the page until an object is clicked
      if (this.page.closest("details") && document.activeElement !== canvas) return;
      event.preventDefault();
      this.enlarge(Math.exp(-event.deltaY / 600));
    }, { passive: false });
    this.select.addEventListener("change", () => this.open());
    for (const input of Object.values(this.inputs)) input.addEventListener("input", () => this.set());
  }

  // Set the target (m) from the pointer: hovering above the visible surface, or pressed below it.
  point(event) {
    const { width, height } = this.canvas, box = this.canvas.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * width, y = ((event.clientY - box.top) / box.height) * height;
    const [r, u, t] = this.axes(), scale = this.scale();
    const seen = this.depth[Math.min(Math.max(Math.floor(y), 0), height - 1) * width + Math.min(Math.max(Math.floor(x), 0), width - 1)];
    const over = seen > -Infinity;
    if (over) this.near = seen; // beside the object the pointer keeps its last depth
    const press = (1e-3 * Number(this.inputs.press.value)) / this.metre;
    const away = this.pressing ? -press : HOVER;
    const z = (over || this.pressing ? this.near ?? 0 : (this.near ?? 0) + HOVER) + away;
    const [a, b] = [(x - width / 2) / scale, (height / 2 - y) / scale];
    this.target = [0, 1, 2].map((k) => this.metre * (a * r[k] + b * u[k] + z * t[k]));
    if (this.alive) this.worker.postMessage({ target: this.target });
  }

  settings() {
    const [, , t] = this.axes();
    return {
      size: this.held.size, stiffness: Number(this.inputs.stiffness.value),
      friction: Number(this.inputs.friction.value),
      target: t.map((c) => 1.9 * c * this.metre), // in front of everything
    };
  }

  set() {
    for (const input of Object.values(this.inputs)) input.nextElementSibling.value = `${input.value} ${input.dataset.unit}`;
    this.worker.postMessage({ stiffness: Number(this.inputs.stiffness.value), friction: Number(this.inputs.friction.value) });
  }

  open() {
    const field = this.held.fields.find((one) => one.name === this.select.value);
    this.alive = false;
    this.worker.postMessage({ bytes: decode(field.bytes, Uint8Array).buffer, name: field.name, settings: this.settings() });
  }

  hear(told) {
    if (told.ready) return this.open();
    if (told.opened !== undefined) {
      this.alive = !told.error;
      this.page.dataset.open = told.error ? "" : told.opened;
      return this.say(told.error ? `${told.opened}: ${told.error}` : "");
    }
    this.told = told;
    for (const force of told.forces) this.forces[this.count++ % SPAN] = force;
    Object.assign(this.page.dataset, {
      newtons: Math.hypot(...told.force), state: told.state, ticks: told.ticks, mean: told.mean, slow: told.slow, slowest: told.slowest,
      proxy: told.proxy, probe: told.probe, depth: told.depth,
    });
    this.over();
  }

  say(text) {
    this.page.querySelector("output.error").value = text;
  }

  draw() {
    [this.image, this.depth] = this.raster(() => [176, 190, 214]);
    this.page.dataset.drawn = this.depth.reduce((sum, d) => sum + (d > -Infinity), 0);
    this.over();
  }

  // Draw the moving parts over the image of the object.
  over() {
    if (this.showing || !this.image) return;
    this.showing = true;
    requestAnimationFrame(() => {
      this.showing = false;
      this.context.putImageData(this.image, 0, 0);
      if (!this.told) return;
      this.marks(this.told);
      this.curve();
      const { force, depth, state, ticks, mean, slow } = this.told;
      const how = state & STICKING ? "sticking" : state & TOUCHING ? "touching" : "free";
      this.page.querySelector("output.figures").value =
        `${Math.hypot(...force).toFixed(2)} N, ${(1e3 * depth).toFixed(2)} mm deep, ${how}; a tick takes ` +
        `${(1e3 * mean).toFixed(1)} µs on average, 99 % of ticks ${Math.max(slow, 0.1).toFixed(1)} ms or less`;
    });
  }

  marks({ probe, proxy, force, state }) {
    const ink = this.context, unit = (point) => point.map((c) => c / this.metre);
    const tip = unit(proxy).map((c, k) => c + ARROW * force[k]);
    const at = this.project(Float32Array.from([...unit(probe), ...unit(proxy), ...tip]));
    const line = (colour, width, ...points) => {
      ink.strokeStyle = ink.fillStyle = colour;
      ink.lineWidth = width;
      ink.beginPath();
      points.forEach(([x, y], i) => (i ? ink.lineTo(x, y) : ink.moveTo(x, y)));
      ink.stroke();
    };
    const [p, q, r] = [[at[0], at[1]], [at[3], at[4]], [at[6], at[7]]];
    line("#5c6675", 1.5, p, q);
    ink.beginPath();
    ink.arc(...p, 4, 0, 7);
    ink.stroke();
    if (state & TOUCHING) {
      line("#b3261e", 3, q, r);
      const [x, y] = [r[0] - q[0], r[1] - q[1]], length = Math.hypot(x, y) || 1, [a, b] = [(8 * x) / length, (8 * y) / length];
      if (length > 6) line("#b3261e", 3, [r[0] - a - 0.6 * b, r[1] - b + 0.6 * a], r, [r[0] - a + 0.6 * b, r[1] - b - 0.6 * a]);
    }
    ink.fillStyle = state & TOUCHING ? "#b3261e" : "#1b7f4c";
    ink.beginPath();
    ink.arc(...q, 5, 0, 7);
    ink.fill();
  }

  curve() {
    const ink = this.plot, { width, height } = ink.canvas, most = Math.max(1, ...this.forces);
    ink.clearRect(0, 0, width, height);
    ink.strokeStyle = "#b3261e";
    ink.beginPath();
    for (let x = 0; x < width; x++) {
      const tick = this.count - SPAN + Math.floor((x / width) * SPAN);
      const y = height - 14 - (height - 28) * (tick < 0 ? 0 : this.forces[tick % SPAN] / most);
      x ? ink.lineTo(x, y) : ink.moveTo(x, y);
    }
    ink.stroke();
    ink.fillStyle = "#5c6675";
    ink.font = "12px system-ui, sans-serif";
    ink.fillText(`${most.toFixed(1)} N`, 4, 12);
    ink.fillText(`the last ${SPAN / 1000} s`, 4, height - 2);
  }
}

// On a page of many objects, each object uses the solid of its view and begins when it is shown; all share the loop.
function begin(page) {
  const read = (from) => JSON.parse(from.querySelector("script[type='application/json']").textContent);
  let held = read(page);
  if (held.view) held = { ...read(document.getElementById("pandis:loop")), ...read(document.getElementById(held.view)), ...held };
  page.touch = new Touch(page, held);
}

for (const page of document.querySelectorAll("section.touch")) {
  const folded = page.closest("details");
  if (!folded) begin(page);
  else
    folded.addEventListener("toggle", () => {
      if (folded.open && !page.touch) begin(page);
      else if (page.touch) page.touch.worker.postMessage({ shown: folded.open });
    });
}

// Unfold the target of a link.
function unfold() {
  const folded = document.getElementById(decodeURIComponent(location.hash.slice(1)))?.closest("details");
  if (folded) folded.open = true;
}
addEventListener("hashchange", unfold);
unfold();
