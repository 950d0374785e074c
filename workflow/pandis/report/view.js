// A mesh that turns under the pointer, coloured by the error of a field: drawn point by point with
// a depth buffer, so that it needs neither a library nor a graphics driver.
"use strict";

const UNIT = 32767, SHADES = 255;

function decode(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Kind(bytes.buffer);
}

// Dark blue over green to yellow, even in brightness (after the colour map viridis).
const STOPS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function colourOf(share) {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const k = Math.min(Math.floor(at), STOPS.length - 2);
  return STOPS[k].map((low, i) => low + (at - k) * (STOPS[k + 1][i] - low));
}
const PALETTE = Array.from({ length: SHADES + 1 }, (_, k) => colourOf(k / SHADES));

class View {
  constructor(figure) {
    this.figure = figure;
    this.canvas = figure.querySelector("canvas");
    this.context = this.canvas.getContext("2d");
    const held = JSON.parse(figure.querySelector("script").textContent);
    this.low = held.low;
    this.high = held.high;
    this.vertices = Float32Array.from(decode(held.vertices, Int16Array), (v) => v / UNIT);
    this.faces = decode(held.faces, held.small ? Uint16Array : Uint32Array);
    this.paths = held.paths.map((p) => Float32Array.from(decode(p, Int16Array), (v) => v / UNIT));
    this.errors = Object.fromEntries(
      Object.entries(held.errors).map(([name, text]) => [name, decode(text, Uint8Array)]));
    this.select = figure.querySelector("select");
    for (const name of Object.keys(this.errors)) this.select.add(new Option(name));
    this.select.value = held.first;
    this.trails = figure.querySelector("input");
    this.reset();
    this.listen();
    this.draw();
  }

  reset() {
    [this.yaw, this.pitch, this.zoom] = [-0.42, 0.3, 1];
  }

  listen() {
    const canvas = this.canvas;
    canvas.tabIndex = 0;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.held = [event.clientX, event.clientY];
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!this.held) return;
      this.turn(event.clientX - this.held[0], event.clientY - this.held[1]);
      this.held = [event.clientX, event.clientY];
    });
    canvas.addEventListener("pointerup", () => (this.held = null));
    canvas.addEventListener("dblclick", () => (this.reset(), this.later()));
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas) return; // the page scrolls until the view is clicked
      event.preventDefault();
      this.enlarge(Math.exp(-event.deltaY / 600));
    }, { passive: false });
    const keys = {
      ArrowLeft: () => this.turn(-20, 0), ArrowRight: () => this.turn(20, 0),
      ArrowUp: () => this.turn(0, -20), ArrowDown: () => this.turn(0, 20),
      "+": () => this.enlarge(1.15), "-": () => this.enlarge(1 / 1.15),
    };
    canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key]) return;
      event.preventDefault();
      keys[event.key]();
    });
    this.select.addEventListener("change", () => this.later());
    this.trails.addEventListener("change", () => this.later());
  }

  turn(x, y) {
    this.yaw -= x / 120;
    this.pitch = Math.min(Math.max(this.pitch + y / 120, -1.57), 1.57);
    this.later();
  }

  enlarge(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.5), 20);
    this.later();
  }

  later() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  // Rows: right, up, toward the eye.
  axes() {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    return [[cy, 0, sy], [sp * sy, cp, -sp * cy], [-cp * sy, sp, cp * cy]];
  }

  project(points) {
    const [r, u, t] = this.axes(), { width, height } = this.canvas;
    const scale = 0.46 * Math.min(width, height) * this.zoom, out = new Float32Array(points.length);
    for (let i = 0; i < points.length; i += 3) {
      const [x, y, z] = [points[i], points[i + 1], points[i + 2]];
      out[i] = width / 2 + scale * (r[0] * x + r[1] * y + r[2] * z);
      out[i + 1] = height / 2 - scale * (u[0] * x + u[1] * y + u[2] * z);
      out[i + 2] = t[0] * x + t[1] * y + t[2] * z;
    }
    return out;
  }

  draw() {
    const { width, height } = this.canvas, image = this.context.createImageData(width, height);
    const depth = new Float32Array(width * height).fill(-Infinity);
    this.fill(image.data, depth, width, height);
    if (this.trails.checked) for (const path of this.paths) this.trail(path, image.data, depth, width, height);
    this.context.putImageData(image, 0, 0);
    this.legend(height);
    this.figure.dataset.drawn = depth.reduce((sum, d) => sum + (d > -Infinity), 0);
  }

  fill(pixels, depth, width, height) {
    const at = this.project(this.vertices), shades = this.errors[this.select.value];
    for (let f = 0; f < this.faces.length; f += 3) {
      const [a, b, c] = [this.faces[f], this.faces[f + 1], this.faces[f + 2]];
      const [ax, ay, bx, by, cx, cy] = [at[3 * a], at[3 * a + 1], at[3 * b], at[3 * b + 1], at[3 * c], at[3 * c + 1]];
      const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
      if (!(area < 0)) continue; // turned away
      const light = this.light(a, b, c);
      const left = Math.max(Math.ceil(Math.min(ax, bx, cx)), 0), right = Math.min(Math.floor(Math.max(ax, bx, cx)), width - 1);
      const top = Math.max(Math.ceil(Math.min(ay, by, cy)), 0), bottom = Math.min(Math.floor(Math.max(ay, by, cy)), height - 1);
      for (let y = top; y <= bottom; y++) {
        for (let x = left; x <= right; x++) {
          const u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area;
          const v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area, w = 1 - u - v;
          if (u < -1e-6 || v < -1e-6 || w < -1e-6) continue;
          const z = u * at[3 * a + 2] + v * at[3 * b + 2] + w * at[3 * c + 2], k = y * width + x;
          if (z <= depth[k]) continue;
          depth[k] = z;
          const shade = shades ? PALETTE[Math.round(u * shades[a] + v * shades[b] + w * shades[c])] : [176, 190, 214];
          for (let i = 0; i < 3; i++) pixels[4 * k + i] = light * shade[i] + 18;
          pixels[4 * k + 3] = 255;
        }
      }
    }
  }

  light(a, b, c) {
    const p = this.vertices, e = [0, 1, 2].map((i) => p[3 * b + i] - p[3 * a + i]), g = [0, 1, 2].map((i) => p[3 * c + i] - p[3 * a + i]);
    const n = [e[1] * g[2] - e[2] * g[1], e[2] * g[0] - e[0] * g[2], e[0] * g[1] - e[1] * g[0]];
    const [, up, toward] = this.axes(), size = Math.hypot(...n) || 1;
    const dot = (m) => (n[0] * m[0] + n[1] * m[1] + n[2] * m[2]) / size;
    return 0.45 + 0.42 * Math.max(dot(toward), 0) + 0.13 * Math.max(dot(up), 0);
  }

  // A path runs a little below the surface: what is nearly in front is shown.
  trail(path, pixels, depth, width, height) {
    const at = this.project(path), length = (i) => Math.hypot(...[3, 4, 5].map((k) => path[i + k] - path[i + k - 3]));
    const lengths = Array.from({ length: path.length / 3 - 1 }, (_, i) => length(3 * i)).sort((a, b) => a - b);
    const usual = lengths[lengths.length >> 1] || Infinity;
    for (let i = 0; i + 3 < at.length; i += 3) {
      const way = Math.hypot(at[i + 3] - at[i], at[i + 4] - at[i + 1]);
      if (length(i) > 8 * usual) continue; // it has begun anew elsewhere
      const steps = Math.ceil(way) + 1;
      for (let s = 0; s < steps; s++) {
        const [x, y, z] = [0, 1, 2].map((k) => at[i + k] + (s / steps) * (at[i + 3 + k] - at[i + k]));
        for (let k = 0; k < 4; k++) this.dot(Math.round(x) + (k & 1), Math.round(y) + (k >> 1), z, pixels, depth, width, height);
      }
    }
  }

  dot(x, y, z, pixels, depth, width, height) {
    if (x < 0 || y < 0 || x >= width || y >= height || z + 0.05 < depth[y * width + x]) return;
    pixels.set([214, 40, 40, 255], 4 * (y * width + x));
  }

  legend(height) {
    const ink = this.context, from = height - 40;
    for (let x = 0; x < 200; x++) {
      ink.fillStyle = `rgb(${colourOf(x / 199).map(Math.round).join(",")})`;
      ink.fillRect(14 + x, from, 1, 10);
    }
    ink.fillStyle = "#1c2330";
    ink.font = "12px system-ui, sans-serif";
    const milli = (power) => `${Number((10 ** power).toPrecision(2))}`;
    ink.textAlign = "left";
    ink.fillText(milli(this.low), 14, from + 25);
    ink.textAlign = "right";
    ink.fillText(`${milli(this.high)} mN`, 214, from + 25);
  }
}

for (const figure of document.querySelectorAll("figure.view")) new View(figure);
