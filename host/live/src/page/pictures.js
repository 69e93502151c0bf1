// The force map and the picture, each on its canvas.

const SIDE = 20;
const SCALE_MIN_N = 0.05;
// Weaker shear than this share of what friction holds at full scale is a dot.
const SHEAR_VISIBLE = 0.02;

// A canvas's context, as many pixels as the screen has there.
export function fit(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

// The smallest of 1, 1.5, 2, 3, 5, 7 times a power of ten that is not below a value: scales that seldom change.
export function roundUp(value, least) {
  const wanted = Math.max(value, least);
  const decade = 10 ** Math.floor(Math.log10(wanted));
  return [1, 1.5, 2, 3, 5, 7, 10].map((step) => step * decade).find((step) => step >= wanted * (1 - 1e-9));
}

const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
const mix = (from, to, share) => from.map((channel, at) => Math.round(channel + (to[at] - channel) * share));

function ramp(stops, level) {
  const place = Math.min(Math.max(level, 0), 1) * (stops.length - 1);
  const below = Math.min(Math.floor(place), stops.length - 2);
  return mix(stops[below], stops[below + 1], place - below);
}

function arrow(context, x, y, dx, dy, size) {
  const length = Math.hypot(dx, dy);
  const [ux, uy] = [dx / length, dy / length];
  const head = size * 0.42;
  const [tipX, tipY] = [x + dx / 2, y + dy / 2];
  context.beginPath();
  context.moveTo(x - dx / 2, y - dy / 2);
  context.lineTo(tipX - ux * head * 0.6, tipY - uy * head * 0.6);
  context.stroke();
  context.beginPath();
  context.moveTo(tipX, tipY);
  context.lineTo(tipX - ux * head - uy * head * 0.6, tipY - uy * head + ux * head * 0.6);
  context.lineTo(tipX - ux * head + uy * head * 0.6, tipY - uy * head - ux * head * 0.6);
  context.fill();
}

// Normal force as colour, cold where a taxel sticks and warm where it slips; shear as an arrow. Row 0 is the lowest.
export function drawMap(canvas, taxels, { friction, peakN, colour }) {
  const { context, width } = fit(canvas);
  const cell = width / SIDE;
  const stops = (name) => [0, 1, 2, 3].map((at) => rgb(colour(`--${name}-${at}`)));
  const [cold, warm, ink] = [stops("cold"), stops("warm"), rgb(colour("--arrow"))];
  const fullN = roundUp(peakN, SCALE_MIN_N);
  context.fillStyle = `rgb(${cold[0]})`;
  context.fillRect(0, 0, width, width);
  context.strokeStyle = colour("--panel");
  context.lineWidth = 1;
  for (let at = 1; at < SIDE; at += 1) {
    context.strokeRect(-1, at * cell, width + 2, 0);
    context.strokeRect(at * cell, -1, 0, width + 2);
  }
  for (const { index, inContact, slips, fx, fy, fz } of taxels) {
    const [column, row] = [index % SIDE, Math.floor(index / SIDE)];
    const [left, top] = [column * cell, (SIDE - 1 - row) * cell];
    const ground = ramp(slips ? warm : cold, (Math.max(fz, 0) / fullN) ** 0.7);
    context.fillStyle = `rgb(${ground})`;
    context.fillRect(left + 0.5, top + 0.5, cell - 1, cell - 1);
    if (!inContact) continue;
    const share = Math.hypot(fx, fy) / (friction * fullN);
    const strength = Math.min(share, 1) ** 0.5;
    const tint = `rgb(${mix(ground, ink, 0.55 + 0.45 * strength)})`;
    const [x, y] = [left + cell / 2, top + cell / 2];
    context.fillStyle = tint;
    context.strokeStyle = tint;
    if (share > SHEAR_VISIBLE) {
      const length = cell * (0.45 + 0.45 * strength);
      const along = Math.hypot(fx, fy);
      context.lineWidth = Math.max(cell / (slips ? 7 : 11), 1);
      arrow(context, x, y, (fx / along) * length, (-fy / along) * length, cell * 0.8);
    } else {
      context.beginPath();
      context.arc(x, y, Math.max(cell / 12, 1), 0, 7);
      context.fill();
    }
  }
  return fullN;
}

// Particles are dim: the picture is made so bright that this share of it is white.
const WHITE_SHARE = 0.002;
const raw = document.createElement("canvas");
let rawOf = null;
let gain = 1;

function brightening(pixels) {
  const counts = new Uint32Array(256);
  for (const pixel of pixels) counts[pixel] += 1;
  let level = 255;
  for (let above = counts[255]; level > 1 && above < WHITE_SHARE * pixels.length; above += counts[level]) level -= 1;
  return 255 / level;
}

// A square picture of grey pixels, smoothed up to the canvas. Returns how much brighter it is than the camera saw it.
export function drawPicture(canvas, pixels) {
  if (pixels !== rawOf) {
    rawOf = pixels;
    const side = Math.sqrt(pixels.length);
    raw.width = side;
    raw.height = side;
    gain = brightening(pixels);
    const image = new ImageData(side, side);
    for (let at = 0; at < pixels.length; at += 1) {
      image.data.fill(pixels[at] * gain, 4 * at, 4 * at + 3);
      image.data[4 * at + 3] = 255;
    }
    raw.getContext("2d").putImageData(image, 0, 0);
  }
  const { context, width, height } = fit(canvas);
  context.imageSmoothingQuality = "high";
  context.drawImage(raw, 0, 0, width, height);
  return gain;
}
