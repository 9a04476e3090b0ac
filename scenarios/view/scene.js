"use strict";
// What pages of a drive share: numbers out of the page, a view of the pipe in perspective, and lines over a series.
// Pipe frame: x right, y down, z along the pipe, mm. The page has a canvas `scene`, and says its size in `view`.
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const floats = (text) => new Float32Array(bytes(text));
const INK = "#222222", FAINT = "#b9c4cc", RED = "#d55e00", ORANGE = "#e69f00", BODY = "#56657a", NEAR_MM = 700;
const scene = document.getElementById("scene"), ink = scene.getContext("2d");
const view = { yaw: 0.9, pitch: 0.35, zoom: 1.5, width: scene.width, height: scene.height };

// Perspective from beside the place looked at; returns pixels and distance, or null behind the eye.
function seen(p, middle) {
  const [x, y, z] = [p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]], { yaw, pitch } = view;
  const right = Math.cos(yaw) * x + Math.sin(yaw) * z, away = -Math.sin(yaw) * x + Math.cos(yaw) * z;
  const down = Math.cos(pitch) * y + Math.sin(pitch) * away, depth = -Math.sin(pitch) * y + Math.cos(pitch) * away + 900;
  if (depth < 60) return null;
  const scale = (900 * view.zoom) / depth;
  return [view.width / 2 + scale * right, view.height / 2 + scale * down, depth];
}

function line(points, middle, color, width, closed) {
  ink.strokeStyle = color;
  ink.lineWidth = width;
  ink.beginPath();
  let drawn = false;
  for (const p of closed ? [...points, points[0]] : points) {
    const at = seen(p, middle);
    if (at && drawn) ink.lineTo(at[0], at[1]);
    else if (at) ink.moveTo(at[0], at[1]);
    drawn = at !== null;
  }
  ink.stroke();
}

function drawPipe(middle, { radius, start, end, outlines }) {
  const around = 36, from = Math.max(start, middle[2] - NEAR_MM), to = Math.min(end, middle[2] + NEAR_MM);
  const at = (k, z) => [radius * Math.sin((2 * Math.PI * k) / around), -radius * Math.cos((2 * Math.PI * k) / around), z];
  for (let z = Math.ceil(from / 50) * 50; z <= to; z += 50)
    line(Array.from({ length: around }, (_, k) => at(k, z)), middle, FAINT, z % 500 === 0 ? 1.5 : 0.5, true);
  for (let k = 0; k < around; k += 3) line([at(k, from), at(k, to)], middle, FAINT, 0.5, false);
  for (const outline of outlines)
    if (outline[0][2] > from - 100 && outline[0][2] < to + 100) line(outline, middle, ORANGE, 2, true);
}

// One panel of a series: title, axes with units, lines with their names, and the place that is shown above.
// `box` has left, top, width, height and the room `right` for names; `along` the places `x`, their `unit` and `now`.
function panel(plot, box, title, along, lines) {
  const { left, top, height } = box, width = box.width - left - box.right;
  const first = along.x[0], last = along.x[along.x.length - 1], span = last - first || 1;
  let low = Infinity, high = -Infinity;
  for (const { values } of lines) for (const v of values) [low, high] = [Math.min(low, v), Math.max(high, v)];
  if (!(high - low > 0.2)) [low, high] = [low - 0.5, high + 0.5];
  const x = (t) => left + (width * (t - first)) / span;
  const y = (v) => top + height - 22 - ((height - 46) * (v - low)) / (high - low);
  plot.fillStyle = INK;
  plot.font = "bold 15px sans-serif";
  plot.fillText(title, left, top + 14);
  plot.font = "13px sans-serif";
  plot.strokeStyle = "#dddddd";
  plot.lineWidth = 1;
  const ticks = width < 400 ? 2 : 4, digits = high - low > 20 ? 0 : high - low > 2 ? 1 : 2, unit = 10 ** digits;
  for (let n = 0; n <= 4; n += 1) {
    const v = low + ((high - low) * n) / 4;
    plot.beginPath();
    plot.moveTo(left, y(v));
    plot.lineTo(left + width, y(v));
    plot.stroke();
    plot.fillText((Math.round(v * unit) / unit + 0).toFixed(digits), 4, y(v) + 4); // + 0: no minus before zero
  }
  for (let n = 0; n <= ticks; n += 1) {
    const t = first + (span * n) / ticks;
    plot.fillText(`${t.toFixed(span < 60 ? 1 : 0)} ${along.unit}`, x(t) - 12, top + height - 4);
  }
  lines.forEach(({ name, values, color }, n) => {
    plot.strokeStyle = plot.fillStyle = color;
    plot.lineWidth = 1.5;
    plot.beginPath();
    values.forEach((v, i) => plot[i ? "lineTo" : "moveTo"](x(along.x[i]), y(v)));
    plot.stroke();
    plot.fillText(name, left + width + 10, top + 34 + 18 * n);
  });
  plot.strokeStyle = INK;
  plot.lineWidth = 1;
  plot.beginPath();
  plot.moveTo(x(along.now), top + 20);
  plot.lineTo(x(along.now), top + height - 20);
  plot.stroke();
}

// Drag, wheel, arrow keys, plus and minus turn and zoom the scene.
function turnable(redraw) {
  const turn = (yaw, pitch) => {
    view.yaw += yaw;
    view.pitch = Math.max(-1.4, Math.min(1.4, view.pitch + pitch));
    redraw();
  };
  const zoom = (by) => {
    view.zoom = Math.max(0.3, Math.min(8, view.zoom * by));
    redraw();
  };
  scene.addEventListener("pointermove", (event) => {
    if (event.buttons) turn(event.movementX * 0.006, event.movementY * 0.006);
  });
  scene.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY * 0.001));
  });
  const keys = {
    ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, -0.1),
    ArrowDown: () => turn(0, 0.1), "+": () => zoom(1.2), "-": () => zoom(1 / 1.2),
  };
  scene.addEventListener("keydown", (event) => {
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
}
