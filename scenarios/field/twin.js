// The twin page, after `scene.js`: one place along the pipe is chosen, and every part shows it.
const twin = JSON.parse(document.getElementById("twin").textContent);
const wall = twin.wall, level = new Uint8Array(bytes(wall.level)), end = wall.start + wall.along * wall.cell;
const { path, defects, shots } = twin, UNSEEN = "#e2e2e2", TURN = 2 * Math.PI;
const element = (id) => document.getElementById(id);
const map = element("map"), flat = map.getContext("2d"), series = element("series"), plot = series.getContext("2d");
let place = defects.length ? defects[0].z : (wall.start + end) / 2, chosen = -1, span = end - wall.start;

// The unrolled wall as a picture, drawn once.
const unrolled = document.createElement("canvas");
[unrolled.width, unrolled.height] = [wall.along, wall.around];
const rgb = [UNSEEN, ...wall.shades].map((hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)));
{
  const pixels = unrolled.getContext("2d").createImageData(wall.along, wall.around);
  level.forEach((value, k) => pixels.data.set([...rgb[value], 255], 4 * k));
  unrolled.getContext("2d").putImageData(pixels, 0, 0);
}
const depthAt = (value) => wall.low + ((wall.high - wall.low) * (value - 1)) / (wall.shades.length - 1);

// Canvases have the pixels that they are shown with.
function fitted(canvas, context) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
  if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return [width, height];
}

// ---- the wall unrolled

const LEFT = 44, TOP = 24, BELOW = 58;
function shownFrom() {
  return Math.max(wall.start, Math.min(end - span, place - span / 2));
}
function onMap() {
  const width = map.clientWidth - LEFT - 8, height = map.clientHeight - TOP - BELOW, from = shownFrom();
  return {
    width, height, from,
    x: (z) => LEFT + ((z - from) / span) * width,
    y: (theta) => TOP + ((((theta % TURN) + TURN) % TURN) / TURN) * height,
  };
}

function drawMap() {
  fitted(map, flat);
  const { width, height, from, x, y } = onMap();
  flat.imageSmoothingEnabled = false;
  flat.drawImage(unrolled, (from - wall.start) / wall.cell, 0, span / wall.cell, wall.around, LEFT, TOP, width, height);
  flat.font = "13px sans-serif";
  flat.fillStyle = INK;
  for (const hour of [0, 3, 6, 9, 12]) flat.fillText(`${hour || 12}:00`, 4, TOP + (hour / 12) * height + 4);
  flat.font = "bold 14px sans-serif";
  flat.fillText("Depth below the local bore", LEFT, 15);
  flat.font = "13px sans-serif";
  const rough = span / (width < 500 ? 4 : 8), ten = 10 ** Math.floor(Math.log10(rough));
  const apart = ten * [1, 2, 5, 10].find((n) => n * ten >= rough);
  flat.textAlign = "center";
  for (let z = Math.ceil(from / apart) * apart; x(z) < LEFT + width - 40; z += apart) {
    stroke(x(z), TOP + height, x(z), TOP + height + 4, INK, 1);
    flat.fillText(z.toFixed(0), x(z), TOP + height + 16);
  }
  flat.textAlign = "left";
  flat.fillText("mm", LEFT + width - 20, TOP + height + 16);
  drawKey(TOP + height + 28, width);
  flat.save();
  flat.beginPath();
  flat.rect(LEFT, TOP, width, height);
  flat.clip();
  for (const z of twin.joints) stroke(x(z), TOP, x(z), TOP + height, ORANGE, 3);
  defects.forEach((one, k) => outline(one, k === chosen, x, y, height));
  stroke(x(place), TOP, x(place), TOP + height, RED, 1.5);
  flat.restore();
}

function stroke(x0, y0, x1, y1, color, width) {
  flat.strokeStyle = color;
  flat.lineWidth = width;
  flat.beginPath();
  flat.moveTo(x0, y0);
  flat.lineTo(x1, y1);
  flat.stroke();
}

// Boxes that cross 12 o'clock are drawn at both ends.
function outline(one, picked, x, y, height) {
  const half = one.width / 2 / twin.radius, wide = x(one.z + one.length / 2) - x(one.z - one.length / 2);
  const tall = (one.width / twin.radius / TURN) * height, top = TOP + ((one.theta - half) / TURN) * height;
  for (const shift of [-height, 0, height]) {
    for (const [color, thick] of [["#ffffff", picked ? 6 : 4], [picked ? RED : INK, picked ? 3 : 1.5]]) {
      flat.strokeStyle = color;
      flat.lineWidth = thick;
      flat.strokeRect(x(one.z - one.length / 2) - 3, top + shift - 3, wide + 6, tall + 6);
    }
  }
  flat.font = "bold 14px sans-serif";
  const [text, left] = [one.name.split(" ")[1], Math.max(x(one.z - one.length / 2) - 3, LEFT + 2)];
  flat.strokeStyle = "#ffffff";
  flat.lineWidth = 4;
  flat.strokeText(text, left, y(one.theta - half) - 7);
  flat.fillStyle = picked ? RED : INK;
  flat.fillText(text, left, y(one.theta - half) - 7);
  flat.font = "13px sans-serif";
}

function drawKey(top, width) {
  const wide = Math.min(220, width / 2), n = wall.shades.length;
  for (let k = 0; k < n; k += 1) {
    flat.fillStyle = wall.shades[k];
    flat.fillRect(LEFT + (wide * k) / n, top, wide / n + 1, 10);
  }
  flat.fillStyle = INK;
  flat.fillText(wall.low.toFixed(1), LEFT, top + 24);
  flat.fillText(`${wall.high.toFixed(1)} mm`, LEFT + wide - 10, top + 24);
  flat.fillStyle = UNSEEN;
  flat.fillRect(LEFT + wide + 60, top, 16, 10);
  flat.fillStyle = INK;
  flat.fillText("not seen", LEFT + wide + 82, top + 10);
}

// ---- the wall in space

const LINES = 72, COLUMNS = 220, SHADED = 4;
const dark = Array.from({ length: SHADED }, (_, b) =>
  rgb.map((c) => `rgb(${c.map((v) => Math.round(v * (0.7 + (0.3 * b) / (SHADED - 1)))).join(",")})`));

// The deepest seen level in a block of the map; 0 where nothing was seen.
function deepest(line, from, to) {
  let most = 0;
  const lines = wall.around / LINES, first = Math.floor(line * lines), last = Math.max(first + 1, Math.floor((line + 1) * lines));
  for (let i = first; i < last; i += 1)
    for (let j = from; j < to; j += 1) most = Math.max(most, level[i * wall.along + j]);
  return most;
}

function drawWall(middle) {
  const from = Math.max(0, Math.floor((middle[2] - NEAR_MM - wall.start) / wall.cell));
  const to = Math.min(wall.along, Math.ceil((middle[2] + NEAR_MM - wall.start) / wall.cell));
  const step = Math.max(1, Math.ceil((to - from) / COLUMNS)), quads = [];
  // the direction in which one looks, across the pipe: what faces against it is the near half
  const [right, down] = [-Math.sin(view.yaw) * Math.cos(view.pitch), -Math.sin(view.pitch)];
  for (let line = 0; line < LINES; line += 1) {
    const theta = (TURN * (line + 0.5)) / LINES, facing = Math.sin(theta) * right - Math.cos(theta) * down;
    if (facing < -0.25) continue;
    for (let j = from; j < to; j += step) {
      const value = deepest(line, j, Math.min(j + step, to));
      if (!value) continue;
      const r = twin.radius + depthAt(value), z0 = wall.start + j * wall.cell, z1 = wall.start + Math.min(j + step, to) * wall.cell;
      const corner = (k, z) => seen([r * Math.sin((TURN * k) / LINES), -r * Math.cos((TURN * k) / LINES), z], middle);
      const corners = [corner(line, z0), corner(line + 1, z0), corner(line + 1, z1), corner(line, z1)];
      if (corners.every(Boolean)) quads.push([corners, dark[Math.min(SHADED - 1, Math.floor(Math.abs(facing) * SHADED))][value]]);
    }
  }
  quads.sort((a, b) => b[0][0][2] - a[0][0][2]);
  for (const [corners, color] of quads) {
    ink.fillStyle = ink.strokeStyle = color;
    ink.lineWidth = 0.6;
    ink.beginPath();
    corners.forEach(([x, y], n) => ink[n ? "lineTo" : "moveTo"](x, y));
    ink.closePath();
    ink.fill();
    ink.stroke();
  }
}

function drawSpace() {
  [view.width, view.height] = fitted(scene, ink);
  const middle = [0, 0, place], now = pose();
  drawWall(middle);
  const near = path.z.map((z, k) => [path.x[k], path.y[k], z]).filter((p) => Math.abs(p[2] - place) < NEAR_MM);
  if (near.length > 1) line(near, middle, RED, 2, false);
  const at = seen([path.x[now], path.y[now], path.z[now]], middle);
  if (at) {
    ink.fillStyle = RED;
    ink.beginPath();
    ink.arc(at[0], at[1], 5, 0, TURN);
    ink.fill();
  }
  defects.forEach((one, k) => {
    if (Math.abs(one.z - place) > NEAR_MM) return;
    const half = one.width / 2 / twin.radius, r = twin.radius;
    const corner = (theta, z) => [r * Math.sin(theta), -r * Math.cos(theta), z], z = [one.z - one.length / 2, one.z + one.length / 2];
    line([corner(one.theta - half, z[0]), corner(one.theta + half, z[0]), corner(one.theta + half, z[1]),
      corner(one.theta - half, z[1])], middle, k === chosen ? RED : ORANGE, k === chosen ? 3 : 1.5, true);
  });
}

// ---- path, roll and slip

// The frame whose rings lie on the chosen place.
function pose() {
  const wanted = place - twin.ahead;
  let best = 0;
  path.z.forEach((z, k) => { if (Math.abs(z - wanted) < Math.abs(path.z[best] - wanted)) best = k; });
  return best;
}

function drawSeries() {
  const [width] = fitted(series, plot), right = width < 500 ? 70 : 100;
  const along = { x: path.z, unit: "mm", now: path.z[pose()] };
  const color = (k) => twin.series[k % twin.series.length];
  const box = (n) => ({ left: 48, right, top: 172 * n, width, height: 165 });
  const bands = () => {
    plot.fillStyle = "#f5d0b5";
    const x = (z) => 48 + ((width - 48 - right) * (z - path.z[0])) / (path.z[path.z.length - 1] - path.z[0] || 1);
    for (const one of twin.episodes) plot.fillRect(x(one.from), 172 * 3 + 20, Math.max(x(one.to) - x(one.from), 2), 123);
  };
  panel(plot, box(0), "Camera off the axis (mm)", along, [
    { name: "right", values: path.x, color: color(0) }, { name: "down", values: path.y, color: color(1) }]);
  panel(plot, box(1), "Roll (degrees)", along, [{ name: "roll", values: path.roll, color: color(0) }]);
  panel(plot, box(2), "Tilt (degrees)", along, [{ name: "tilt", values: path.tilt, color: color(0) }]);
  bands();
  const wheels = twin.slip || [path.z.map(() => 0)];
  panel(plot, box(3), "Slip (mm since the start)", along, wheels.map((values, k) =>
    ({ name: twin.slip ? `wheel ${k}` : "", values, color: color(k) })));
}

// ---- one place for all

function show() {
  place = Math.max(wall.start, Math.min(end, place));
  element("place").value = place;
  const k = pose();
  element("where").textContent = `${place.toFixed(0)} mm; camera at ${path.z[k].toFixed(0)} mm, ${path.time[k].toFixed(1)} s`;
  drawMap();
  drawSpace();
  drawSeries();
  if (!shots.length) return;
  const wanted = place - twin.ahead;
  const best = shots.reduce((a, b) => (Math.abs(b.z - wanted) < Math.abs(a.z - wanted) ? b : a));
  element("shot").src = `data:image/jpeg;base64,${best.jpeg}`;
  element("shot").alt = `The camera's picture at ${best.z} mm`;
  element("shown").textContent = `Camera at ${best.z.toFixed(0)} mm, about ${twin.ahead.toFixed(0)} mm before the place shown.`;
}

// From the side across the pipe, so that a defect is not in the near half.
function lookAt(one) {
  view.yaw = Math.sin(one.theta) >= 0 ? -0.9 : 0.9;
  view.pitch = Math.cos(one.theta) >= 0 ? 0.35 : -0.35;
}

function choose(k) {
  chosen = k;
  const one = defects[k];
  element("selected").textContent = `${one.name}: ${one.words}`;
  document.querySelectorAll("[data-defect]").forEach((button) =>
    button.setAttribute("aria-pressed", String(Number(button.dataset.defect) === k)));
  place = one.z;
  lookAt(one);
  show();
}

const step = (by) => { if (defects.length) choose((chosen + by + defects.length + (chosen < 0 && by < 0 ? 1 : 0)) % defects.length); };
const zoom = (by) => { span = Math.max(60, Math.min(end - wall.start, span * by)); show(); };

element("place").addEventListener("input", (event) => { place = Number(event.target.value); show(); });
element("before").addEventListener("click", () => step(-1));
element("next").addEventListener("click", () => step(1));
element("nearer").addEventListener("click", () => zoom(0.5));
element("further").addEventListener("click", () => zoom(2));
element("whole").addEventListener("click", () => zoom(Infinity));
document.querySelectorAll("[data-defect]").forEach((button) =>
  button.addEventListener("click", () => choose(Number(button.dataset.defect))));
map.addEventListener("click", (event) => {
  const { width, height, from } = onMap(), half = 8;
  const z = from + ((event.offsetX - LEFT) / width) * span, theta = ((event.offsetY - TOP) / height) * TURN;
  const hit = defects.findIndex((one) => {
    const turn = Math.abs(((theta - one.theta + 3 * Math.PI) % TURN) - Math.PI), slack = (half * span) / width;
    return Math.abs(z - one.z) <= one.length / 2 + slack && turn <= one.width / 2 / twin.radius + (half / height) * TURN;
  });
  if (hit >= 0) return choose(hit);
  place = z;
  return show();
});
map.addEventListener("keydown", (event) => {
  const keys = {
    ArrowLeft: () => { place -= span / 100; show(); }, ArrowRight: () => { place += span / 100; show(); },
    n: () => step(1), p: () => step(-1), "+": () => zoom(0.5), "-": () => zoom(2),
  };
  if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  keys[event.key]();
});
turnable(drawSpace);
window.addEventListener("resize", show);
view.zoom = Math.max(0.5, Math.min(1.2, scene.clientWidth / 800));
if (defects.length) lookAt(defects[0]);
show();
