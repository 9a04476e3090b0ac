// Plays one drive, after `scene.js`.
const drive = JSON.parse(document.getElementById("drive").textContent);
const pose = floats(drive.pose), hubs = floats(drive.hubs), spin = floats(drive.spin);
const slip = floats(drive.slip), force = floats(drive.force), rays = floats(drive.rays), cloud = floats(drive.cloud);
const light = new Uint16Array(bytes(drive.light)), shade = new Uint8Array(bytes(drive.shade));
const frames = drive.time.length, wheels = drive.wheels, [slits, azimuths] = drive.slits;
const SLIPPING_MM_S = 5;

const series = document.getElementById("series"), plot = series.getContext("2d");
let frame = 0, clock = 0, playing = false, last = 0;

// A point of the camera frame of this frame's pose, in the pipe frame.
const placed = (p) => [0, 1, 2].map((r) => {
  const k = 12 * frame + 4 * r;
  return pose[k] * p[0] + pose[k + 1] * p[1] + pose[k + 2] * p[2] + pose[k + 3];
});

function drawCloud(middle) {
  for (let i = 0; i < shade.length; i += 1) {
    if (Math.abs(cloud[3 * i + 2] - middle[2]) > NEAR_MM) continue;
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
  drawPipe(middle, drive.pipe);
  drawCloud(middle);
  drawLight(middle);
  if (wheels) drawCylinder(middle, r.radius, -r.ahead - r.length / 2, -r.ahead + r.length / 2, BODY);
  drawCylinder(middle, r.sensorRadius, -r.sensorLength, 0, INK);
  for (let w = 0; w < wheels; w += 1) drawWheel(middle, w);
}

const box = (top, height) => ({ left: 70, right: 130, top, width: series.width, height });
const over = (top, height, title, lines) =>
  panel(plot, box(top, height), title, { x: drive.time, unit: "s", now: drive.time[frame] }, lines);

const column = (values, w) => Array.from({ length: frames }, (_, i) => values[i * wheels + w]);
const legs = wheels ? Array.from({ length: drive.robot.legs }, (_, leg) => leg) : [];
const ofLegs = (values) => legs.map((leg) => ({ name: `leg ${leg}, front`, values: column(values, 2 * leg), color: drive.series[leg] }));

function drawSeries() {
  plot.clearRect(0, 0, series.width, series.height);
  over(0, 170, "Roll (degrees)", [{ name: "roll", values: drive.roll, color: drive.series[0] }]);
  if (!wheels) return;
  over(175, 170, "Slip of the wheels (mm/s)", ofLegs(slip));
  over(350, 170, "Contact force (N)", ofLegs(force));
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
turnable(drawScene);
show(Math.floor(frames / 3));
