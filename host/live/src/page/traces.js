// The last ten seconds: stick ratio with evidence and threshold; line with its limits and the forces.

import { fit, roundUp } from "./pictures.js";

const SPAN_S = 10;
const FORCE_AXIS_MIN_N = 5;
const LEFT = 34;
const MARGIN = 8;

// What the traces are drawn from; a clock that jumps back starts anew.
export class History {
  samples = [];

  push({ report, taxels }) {
    const last = this.samples.at(-1);
    if (last && report.t_s < last.t) this.samples = [];
    this.samples.push({
      t: report.t_s,
      ratio: report.stick_ratio,
      world: report.truth ? report.truth.stick_ratio : null,
      evidence: report.stick_ratio === null ? null : report.slip_evidence,
      line: report.line_n,
      normal: report.fn,
      shear: report.ft,
      peakN: taxels.reduce((most, { fz }) => Math.max(most, fz), 0),
    });
    const first = this.samples.findIndex(({ t }) => t >= report.t_s - SPAN_S);
    this.samples.splice(0, Math.max(first, 0));
  }

  greatest(of) {
    return this.samples.reduce((most, sample) => Math.max(most, of(sample)), 0);
  }
}

function plot(canvas, history, top, { marks, traces, colour }) {
  const { context, width, height } = fit(canvas);
  const now = history.samples.at(-1)?.t ?? 0;
  const x = (t) => LEFT + ((t - now + SPAN_S) / SPAN_S) * (width - LEFT - 2);
  const y = (value) => height - MARGIN - (Math.min(Math.max(value, 0), top) / top) * (height - 2 * MARGIN);
  context.font = "12px ui-sans-serif, system-ui, sans-serif";
  context.textAlign = "right";
  context.textBaseline = "middle";
  context.fillStyle = colour("--dim");
  context.strokeStyle = colour("--edge");
  context.lineWidth = 1;
  for (const share of [0, 0.5, 1]) {
    const value = share * top;
    context.fillText(`${Number(value.toFixed(2))}`, LEFT - 6, y(value));
    context.beginPath();
    context.moveTo(LEFT, y(value));
    context.lineTo(width, y(value));
    context.stroke();
  }
  context.setLineDash([5, 4]);
  for (const [value, name] of marks) {
    if (value > top) continue;
    context.strokeStyle = colour(name);
    context.beginPath();
    context.moveTo(LEFT, y(value));
    context.lineTo(width, y(value));
    context.stroke();
  }
  context.setLineDash([]);
  context.lineJoin = "round";
  for (const [of, name, thick] of traces) {
    context.strokeStyle = colour(name);
    context.lineWidth = thick;
    context.beginPath();
    let pen = false;
    for (const sample of history.samples) {
      const value = of(sample);
      if (value === null || value === undefined) {
        pen = false;
        continue;
      }
      if (pen) context.lineTo(x(sample.t), y(value));
      else context.moveTo(x(sample.t), y(value));
      pen = true;
    }
    context.stroke();
  }
}

export function drawTraces(ratio, force, history, limits, colour) {
  plot(ratio, history, 1, {
    marks: [[limits.slip_threshold, "--threshold"]],
    traces: [
      [(sample) => sample.world, "--world", 1.5],
      [(sample) => sample.evidence, "--evidence", 1.5],
      [(sample) => sample.ratio, "--mcu", 2.5],
    ],
    colour,
  });
  const most = history.greatest(({ line, normal, shear }) => Math.max(line, normal, shear));
  plot(force, history, roundUp(most, Math.max(limits.floor_n, FORCE_AXIS_MIN_N)), {
    marks: [[limits.floor_n, "--limit"], [limits.ceiling_n, "--limit"]],
    traces: [
      [(sample) => sample.shear, "--shear", 1.5],
      [(sample) => sample.line, "--line", 3],
      [(sample) => sample.normal, "--normal", 1.25],
    ],
    colour,
  });
}
