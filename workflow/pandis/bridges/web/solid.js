// A mesh that can be rotated: drawn pixel by pixel with a depth buffer, so that it needs neither a
// library nor a graphics driver.
"use strict";

const UNIT = 32767;

function decode(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Kind(bytes.buffer);
}

// Positions are integers, in steps of 1/32767 of a unit-frame length.
function decodePoints(text) {
  return Float32Array.from(decode(text, Int16Array), (v) => v / UNIT);
}

class Solid {
  constructor(canvas, held) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.vertices = decodePoints(held.vertices);
    this.faces = decode(held.faces, held.small ? Uint16Array : Uint32Array);
    this.up = held.up || "y";
    this.reset();
  }

  reset() {
    [this.yaw, this.pitch, this.zoom] = [-0.42, 0.3, 1];
  }

  // Rotate and zoom with keys; reset with a double click.
  steer() {
    const canvas = this.canvas;
    canvas.tabIndex = 0;
    canvas.addEventListener("dblclick", () => (this.reset(), this.later()));
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
    const rows = [[cy, 0, sy], [sp * sy, cp, -sp * cy], [-cp * sy, sp, cp * cy]];
    if (this.up === "x") return rows.map(([x, y, z]) => [y, -x, z]);
    return this.up === "z" ? rows.map(([x, y, z]) => [x, -z, y]) : rows;
  }

  // Pixels per unit-frame length.
  scale() {
    return 0.46 * Math.min(this.canvas.width, this.canvas.height) * this.zoom;
  }

  project(points) {
    const [r, u, t] = this.axes(), { width, height } = this.canvas;
    const scale = this.scale(), out = new Float32Array(points.length);
    for (let i = 0; i < points.length; i += 3) {
      const [x, y, z] = [points[i], points[i + 1], points[i + 2]];
      out[i] = width / 2 + scale * (r[0] * x + r[1] * y + r[2] * z);
      out[i + 1] = height / 2 - scale * (u[0] * x + u[1] * y + u[2] * z);
      out[i + 2] = t[0] * x + t[1] * y + t[2] * z;
    }
    return out;
  }

  // Return the image and its depth, which is -Infinity on the background. colour(a, b, c, u, v, w)
  // returns the colour of a point between the corners a, b and c.
  raster(colour) {
    const { width, height } = this.canvas, image = this.context.createImageData(width, height);
    const pixels = image.data, depth = new Float32Array(width * height).fill(-Infinity);
    const at = this.project(this.vertices);
    for (let f = 0; f < this.faces.length; f += 3) {
      const [a, b, c] = [this.faces[f], this.faces[f + 1], this.faces[f + 2]];
      const [ax, ay, bx, by, cx, cy] = [at[3 * a], at[3 * a + 1], at[3 * b], at[3 * b + 1], at[3 * c], at[3 * c + 1]];
      const area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
      if (!(area < 0)) continue; // faces away
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
          const shade = colour(a, b, c, u, v, w);
          for (let i = 0; i < 3; i++) pixels[4 * k + i] = light * shade[i] + 18;
          pixels[4 * k + 3] = 255;
        }
      }
    }
    return [image, depth];
  }

  light(a, b, c) {
    const p = this.vertices, e = [0, 1, 2].map((i) => p[3 * b + i] - p[3 * a + i]), g = [0, 1, 2].map((i) => p[3 * c + i] - p[3 * a + i]);
    const n = [e[1] * g[2] - e[2] * g[1], e[2] * g[0] - e[0] * g[2], e[0] * g[1] - e[1] * g[0]];
    const [, up, toward] = this.axes(), size = Math.hypot(...n) || 1;
    const dot = (m) => (n[0] * m[0] + n[1] * m[1] + n[2] * m[2]) / size;
    return 0.45 + 0.42 * Math.max(dot(toward), 0) + 0.13 * Math.max(dot(up), 0);
  }
}
