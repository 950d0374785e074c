// A solid coloured by the error of a field.
"use strict";

const SHADES = 255;

// From dark blue through green to yellow, in even steps of brightness (after the viridis colour map).
const STOPS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
function colourOf(share) {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const k = Math.min(Math.floor(at), STOPS.length - 2);
  return STOPS[k].map((low, i) => low + (at - k) * (STOPS[k + 1][i] - low));
}
const PALETTE = Array.from({ length: SHADES + 1 }, (_, k) => colourOf(k / SHADES));

class View extends Solid {
  constructor(figure) {
    const held = JSON.parse(figure.querySelector("script").textContent);
    super(figure.querySelector("canvas"), held);
    this.figure = figure;
    this.low = held.low;
    this.high = held.high;
    this.paths = held.paths.map(decodePoints);
    this.errors = Object.fromEntries(
      Object.entries(held.errors).map(([name, text]) => [name, decode(text, Uint8Array)]));
    this.select = figure.querySelector("select");
    for (const name of Object.keys(this.errors)) this.select.add(new Option(name));
    this.select.value = held.first;
    this.trails = figure.querySelector("input");
    this.listen();
    this.draw();
  }

  listen() {
    const canvas = this.canvas;
    this.steer();
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
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas) return; // the page scrolls until the view is clicked
      event.preventDefault();
      this.enlarge(Math.exp(-event.deltaY / 600));
    }, { passive: false });
    this.select.addEventListener("change", () => this.later());
    this.trails.addEventListener("change", () => this.later());
  }

  draw() {
    const shades = this.errors[this.select.value];
    const [image, depth] = this.raster((a, b, c, u, v, w) =>
      shades ? PALETTE[Math.round(u * shades[a] + v * shades[b] + w * shades[c])] : [176, 190, 214]);
    const { width, height } = image;
    if (this.trails.checked) for (const path of this.paths) this.trail(path, image.data, depth, width, height);
    this.context.putImageData(image, 0, 0);
    this.legend(height);
    this.figure.dataset.drawn = depth.reduce((sum, d) => sum + (d > -Infinity), 0);
  }

  // A path runs a little below the surface: points that are only just hidden are shown.
  trail(path, pixels, depth, width, height) {
    const at = this.project(path), length = (i) => Math.hypot(...[3, 4, 5].map((k) => path[i + k] - path[i + k - 3]));
    const lengths = Array.from({ length: path.length / 3 - 1 }, (_, i) => length(3 * i)).sort((a, b) => a - b);
    const usual = lengths[lengths.length >> 1] || Infinity;
    for (let i = 0; i + 3 < at.length; i += 3) {
      const way = Math.hypot(at[i + 3] - at[i], at[i + 4] - at[i + 1]);
      if (length(i) > 8 * usual) continue; // the path starts again elsewhere
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
