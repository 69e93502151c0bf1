// The page: what comes in is kept, and drawn when the screen is next drawn.

import { startControl } from "./control.js";
import { listen } from "./events.js";
import { drawMap, drawPicture } from "./pictures.js";
import { History, drawTraces } from "./traces.js";
import { say, showAlarm, showNumbers, showState, showStatus } from "./words.js";

const byId = (id) => document.getElementById(id);

const fingertips = [0, 1].map(() => ({ history: new History(), frame: null, pixels: null }));
let shown = 0;
let status = null;
let isThere = null;
let isDrawing = false;

const style = getComputedStyle(document.documentElement);
let colours = new Map();
function colour(name) {
  if (!colours.has(name)) colours.set(name, style.getPropertyValue(name).trim());
  return colours.get(name);
}

// For whoever measures: when the first picture was drawn, and how old each frame was then (one clock: same machine only).
const measured = { firstPictureMs: null, delaysMs: [] };
window.gripline = measured;

function draw() {
  isDrawing = false;
  const { history, frame, pixels } = fingertips[shown];
  if (!frame) return;
  const peakN = history.greatest((sample) => sample.peakN);
  const fullN = drawMap(byId("map"), frame.taxels, { friction: frame.limits.friction, peakN, colour });
  say("scale", `${fullN.toFixed(2)} N`);
  if (pixels) say("gain", `${drawPicture(byId("picture"), pixels).toFixed(1)} times brighter than seen`);
  drawTraces(byId("ratio"), byId("force"), history, frame.limits, colour);
  showState(frame.report);
  showNumbers(frame);
  measured.delaysMs.push(Date.now() - frame.sent_ms);
  measured.delaysMs.splice(0, measured.delaysMs.length - 1000);
  if (pixels) measured.firstPictureMs ??= performance.now();
}

function drawSoon() {
  if (isDrawing) return;
  isDrawing = true;
  requestAnimationFrame(draw);
}

// For those who do not see it, once a second.
setInterval(() => {
  const { frame } = fingertips[shown];
  if (!frame) return;
  const { report } = frame;
  byId("map").setAttribute("aria-label", `Force map: ${report.contact} taxels in contact, ${report.contact - report.stick} slip`);
  byId("ratio").setAttribute("aria-label", `Stick ratio ${report.stick_ratio?.toFixed(2) ?? "none"}, evidence of slip ${report.slip_evidence.toFixed(2)}`);
  byId("force").setAttribute("aria-label", `Line ${report.line_n.toFixed(1)} N, normal force ${report.fn.toFixed(1)} N, shear ${report.ft.toFixed(1)} N`);
}, 1000);

byId("fingertips").addEventListener("click", (event) => {
  const buttons = [...byId("fingertips").children];
  const at = buttons.indexOf(event.target);
  if (at < 0) return;
  shown = at;
  buttons.forEach((button, other) => button.setAttribute("aria-pressed", `${other === at}`));
  drawSoon();
});

matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => {
  colours = new Map();
  drawSoon();
});
new ResizeObserver(drawSoon).observe(document.body);

startControl();
listen({
  onFrame(frame) {
    const fingertip = fingertips[frame.report.sensor] ?? fingertips[0];
    fingertip.history.push(frame);
    fingertip.frame = frame;
    fingertip.pixels = frame.pixels ?? fingertip.pixels;
    if (frame.report.sensor === 1) byId("fingertips").hidden = false;
    drawSoon();
  },
  onStatus(now) {
    status = now;
    showStatus(status);
    showAlarm(isThere, status);
    const floor = byId("floor");
    if (!floor.value && status.floor_n > 0) floor.value = status.floor_n.toFixed(1);
  },
  onPresence(now) {
    isThere = now;
    showAlarm(isThere, status);
  },
});
