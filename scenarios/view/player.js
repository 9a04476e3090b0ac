"use strict";
// Plays one drive. Pipe frame: x right, y down, z along the pipe, mm.
const drive = JSON.parse(document.getElementById("drive").textContent);
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const floats = (text) => new Float32Array(bytes(text));
const pose = floats(drive.pose), hubs = floats(drive.hubs), spin = floats(drive.spin);
const slip = floats(drive.slip), force = floats(drive.force), rays = floats(drive.rays), cloud = floats(drive.cloud);
const light = new Uint16Array(bytes(drive.light)), shade = new Uint8Array(bytes(drive.shade));
const frames = drive.time.length, wheels = drive.wheels, [slits, azimuths] = drive.slits;
const INK = "#222222", FAINT = "#b9c4cc", RED = "#d55e00", ORANGE = "#e69f00", BODY = "#56657a", SLIPPING_MM_S = 5;

const scene = document.getElementById("scene"), series = document.getElementById("series");
const ink = scene.getContext("2d"), plot = series.getContext("2d");
let frame = 0, clock = 0, playing = false, yaw = 0.9, pitch = 0.35, zoom = 1.5, last = 0;

// A point of the camera frame of this frame's pose, in the pipe frame.
const placed = (p) => [0, 1, 2].map((r) => {
  const k = 12 * frame + 4 * r;
  return pose[k] * p[0] + pose[k + 1] * p[1] + pose[k + 2] * p[2] + pose[k + 3];
});

// Perspective from beside the robot; returns pixels and distance, or null behind the eye.
function seen(p, middle) {
  const [x, y, z] = [p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]];
  const right = Math.cos(yaw) * x + Math.sin(yaw) * z, away = -Math.sin(yaw) * x + Math.cos(yaw) * z;
  const down = Math.cos(pitch) * y + Math.sin(pitch) * away, depth = -Math.sin(pitch) * y + Math.cos(pitch) * away + 900;
  if (depth < 60) return null;
  const scale = (900 * zoom) / depth;
  return [scene.width / 2 + scale * right, scene.height / 2 + scale * down, depth];
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

function drawPipe(middle) {
  const { radius, start, end, outlines } = drive.pipe, around = 36;
  const from = Math.max(start, middle[2] - 700), to = Math.min(end, middle[2] + 700);
  const at = (k, z) => [radius * Math.sin((2 * Math.PI * k) / around), -radius * Math.cos((2 * Math.PI * k) / around), z];
  for (let z = Math.ceil(from / 50) * 50; z <= to; z += 50)
    line(Array.from({ length: around }, (_, k) => at(k, z)), middle, FAINT, z % 500 === 0 ? 1.5 : 0.5, true);
  for (let k = 0; k < around; k += 3) line([at(k, from), at(k, to)], middle, FAINT, 0.5, false);
  for (const outline of outlines)
    if (outline[0][2] > from - 100 && outline[0][2] < to + 100) line(outline, middle, ORANGE, 2, true);
}

function drawCloud(middle) {
  for (let i = 0; i < shade.length; i += 1) {
    if (Math.abs(cloud[3 * i + 2] - middle[2]) > 700) continue;
    const at = seen([cloud[3 * i], cloud[3 * i + 1], cloud[3 * i + 2]], middle);
    if (!at) continue;
    ink.fillStyle = drive.shades[shade[i]];
    ink.fillRect(at[0], at[1], 1.6, 1.6);
  }
}

function drawLight(middle) {
  for (let s = 0; s < slits; s += 1) {
    const ring = [];
    for (let a = 0; a < azimuths; a += 1) {
      const k = s * azimuths + a, range = light[frame * slits * azimuths + k] / 10;
      if (range > 0) ring.push(placed([0, 1, 2].map((c) => drive.apex[c] + range * rays[3 * k + c])));
    }
    if (ring.length > 2) line(ring, middle, drive.series[s % drive.series.length], 1.8, true);
    if (s === slits - 1)
      for (let a = 0; a < ring.length; a += Math.ceil(azimuths / 6)) line([placed(drive.apex), ring[a]], middle, "#8888", 0.7, false);
  }
}

// A cylinder about the camera's z axis: two circles and lines between them.
function drawCylinder(middle, radius, from, to, color) {
  const circle = (z) => Array.from({ length: 24 }, (_, k) =>
    placed([radius * Math.sin((Math.PI * k) / 12), -radius * Math.cos((Math.PI * k) / 12), z]));
  const [a, b] = [circle(from), circle(to)];
  line(a, middle, color, 1.6, true);
  line(b, middle, color, 1.6, true);
  for (let k = 0; k < 24; k += 3) line([a[k], b[k]], middle, color, 0.9, false);
}

function drawWheel(middle, w) {
  const r = drive.robot, k = 3 * (frame * wheels + w), end = w >= 2 * r.legs;
  const hub = [hubs[k], hubs[k + 1], hubs[k + 2]], radius = end ? r.endWheel : r.wheel;
  const i = 12 * frame, axis = [pose[i + 2], pose[i + 6], pose[i + 10]];
  const foot = [0, 1, 2].map((c) => pose[i + 4 * c + 3]);
  const along = [0, 1, 2].reduce((sum, c) => sum + (hub[c] - foot[c]) * axis[c], 0);
  const root = [0, 1, 2].map((c) => foot[c] + along * axis[c]);
  let out = [0, 1, 2].map((c) => hub[c] - root[c]);
  const length = Math.hypot(...out);
  out = out.map((v) => v / length);
  const across = [axis[1] * out[2] - axis[2] * out[1], axis[2] * out[0] - axis[0] * out[2], axis[0] * out[1] - axis[1] * out[0]];
  // legs roll along the pipe, end wheels around it
  const second = end ? across : axis;
  const rim = (turn) => [0, 1, 2].map((c) => hub[c] + radius * (Math.cos(turn) * out[c] + Math.sin(turn) * second[c]));
  const at = frame * wheels + w, color = Math.abs(slip[at]) > SLIPPING_MM_S ? RED : INK;
  line(Array.from({ length: 20 }, (_, n) => rim((Math.PI * n) / 10)), middle, color, force[at] > 0 ? 3 : 1, true);
  line([rim(spin[at]), rim(spin[at] + Math.PI)], middle, color, 1, false);
  line([root, hub], middle, BODY, 2, false);
}

function drawScene() {
  const r = drive.robot, middle = placed([0, 0, -r.ahead / 2]);
  ink.clearRect(0, 0, scene.width, scene.height);
  drawPipe(middle);
  drawCloud(middle);
  drawLight(middle);
  if (wheels) drawCylinder(middle, r.radius, -r.ahead - r.length / 2, -r.ahead + r.length / 2, BODY);
  drawCylinder(middle, r.sensorRadius, -r.sensorLength, 0, INK);
  for (let w = 0; w < wheels; w += 1) drawWheel(middle, w);
}

// One panel of the time series: title, axes with units, lines and the time that is shown above.
function panel(top, height, title, lines) {
  const left = 70, width = series.width - left - 130, end = drive.time[frames - 1];
  let low = Infinity, high = -Infinity;
  for (const { values } of lines) for (const v of values) [low, high] = [Math.min(low, v), Math.max(high, v)];
  if (!(high - low > 0.2)) [low, high] = [low - 0.5, high + 0.5];
  const x = (t) => left + (width * t) / end, y = (v) => top + height - 22 - ((height - 46) * (v - low)) / (high - low);
  plot.fillStyle = INK;
  plot.font = "bold 15px sans-serif";
  plot.fillText(title, left, top + 14);
  plot.font = "13px sans-serif";
  plot.strokeStyle = "#dddddd";
  plot.lineWidth = 1;
  for (let n = 0; n <= 4; n += 1) {
    const v = low + ((high - low) * n) / 4, t = (end * n) / 4;
    plot.beginPath();
    plot.moveTo(left, y(v));
    plot.lineTo(left + width, y(v));
    plot.stroke();
    plot.fillText(v.toFixed(high - low > 20 ? 0 : 1), 8, y(v) + 4);
    plot.fillText(`${t.toFixed(end < 60 ? 1 : 0)} s`, x(t) - 12, top + height - 4);
  }
  lines.forEach(({ name, values, color }, n) => {
    plot.strokeStyle = plot.fillStyle = color;
    plot.lineWidth = 1.5;
    plot.beginPath();
    values.forEach((v, i) => plot[i ? "lineTo" : "moveTo"](x(drive.time[i]), y(v)));
    plot.stroke();
    plot.fillText(name, left + width + 10, top + 34 + 18 * n);
  });
  plot.strokeStyle = INK;
  plot.lineWidth = 1;
  plot.beginPath();
  plot.moveTo(x(drive.time[frame]), top + 20);
  plot.lineTo(x(drive.time[frame]), top + height - 20);
  plot.stroke();
}

const column = (values, w) => Array.from({ length: frames }, (_, i) => values[i * wheels + w]);
const legs = wheels ? Array.from({ length: drive.robot.legs }, (_, leg) => leg) : [];
const ofLegs = (values) => legs.map((leg) => ({ name: `leg ${leg}, front`, values: column(values, 2 * leg), color: drive.series[leg] }));

function drawSeries() {
  plot.clearRect(0, 0, series.width, series.height);
  panel(0, 170, "Roll (degrees)", [{ name: "roll", values: drive.roll, color: drive.series[0] }]);
  if (!wheels) return;
  panel(175, 170, "Slip of the wheels (mm/s)", ofLegs(slip));
  panel(350, 170, "Contact force (N)", ofLegs(force));
}

function show(at) {
  frame = Math.max(0, Math.min(frames - 1, at));
  document.getElementById("at").value = frame;
  const z = pose[12 * frame + 11];
  document.getElementById("now").textContent = `${drive.time[frame].toFixed(1)} s, camera at ${z.toFixed(0)} mm`;
  drawScene();
  drawSeries();
}

function tick(now) {
  if (!playing) return;
  clock += ((now - last) / 1000) * Number(document.getElementById("speed").value);
  last = now;
  let at = frame;
  while (at < frames - 1 && drive.time[at + 1] <= clock) at += 1;
  if (at !== frame) show(at);
  if (at === frames - 1) stop();
  else requestAnimationFrame(tick);
}

function stop() {
  playing = false;
  document.getElementById("play").textContent = "Play";
}

document.getElementById("play").addEventListener("click", () => {
  if (playing) return stop();
  if (frame === frames - 1) show(0);
  [playing, clock, last] = [true, drive.time[frame], performance.now()];
  document.getElementById("play").textContent = "Pause";
  return requestAnimationFrame(tick);
});
document.getElementById("at").addEventListener("input", (event) => {
  show(Number(event.target.value));
  clock = drive.time[frame];
});
scene.addEventListener("pointermove", (event) => {
  if (!event.buttons) return;
  yaw += event.movementX * 0.006;
  pitch = Math.max(-1.4, Math.min(1.4, pitch + event.movementY * 0.006));
  drawScene();
});
scene.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom = Math.max(0.3, Math.min(8, zoom * Math.exp(-event.deltaY * 0.001)));
  drawScene();
});
show(Math.floor(frames / 3));
