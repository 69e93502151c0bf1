// What is said in words: state, faults, alarms, numbers.

const byId = (id) => document.getElementById(id);

// Only what changed: a screen reader speaks of every change.
export function say(id, text) {
  const element = typeof id === "string" ? byId(id) : id;
  if (element.textContent !== text) element.textContent = text;
}

const number = (value, digits, unit = "") => (Number.isFinite(value) ? `${value.toFixed(digits)}${unit}` : "–");
const percent = (share) => `${Math.round(100 * share)}`;

export function showState(report) {
  const state = byId("state");
  say(state, report.state.replace("_", " "));
  state.dataset.state = report.state;
  say("time-to-slip", report.time_to_slip_ms === null ? "–" : `${report.time_to_slip_ms} ms`);
}

export function showNumbers({ report, limits }) {
  const { witnesses } = report;
  say("line", number(report.line_n, 2, " N"));
  say("normal", number(report.fn, 2, " N"));
  say("shear", number(report.ft, 2, " N"));
  say("moment", number(report.mz, 1, " Nmm"));
  say("stick-ratio", report.stick_ratio === null ? "–" : number(report.stick_ratio, 3));
  say("contact", `${report.contact} taxels, ${report.stick} stick`);
  say("evidence", `${percent(report.slip_evidence)} %`);
  say("witnesses", `SR ${percent(witnesses.stick_ratio)}, unrest ${percent(witnesses.unrest)}, grip ${percent(witnesses.shear_follows)}, seen ${percent(witnesses.motion)}`);
  say("gate", report.late ? `late ${report.late}` : report.gate.replace("_", " "));
  say("latency", `${Math.round(report.latency_us)} µs`);
  say("frame", `${report.frame}`);
  say("health", report.health.length ? `doubtful: ${report.health.join(", ").replaceAll("_", " ")}` : "");
  byId("scene-part").hidden = !report.truth;
  document.querySelector(".key.world").hidden = !report.truth;
  if (report.truth) say("scene", `${report.truth.phase}, slid ${number(report.truth.slip_mm, 2, " mm")}`);
  say("gauge-floor", number(limits.floor_n, 1));
  say("gauge-ceiling", number(limits.ceiling_n, 1, " N"));
  const gauge = byId("gauge");
  [gauge.min, gauge.max, gauge.value] = [limits.floor_n, limits.ceiling_n, report.line_n];
}

export function showStatus(status) {
  say("link", `${status.link || "no microcontroller yet"}${status.mode ? `, ${status.mode}` : ""}`);
  say("owner", status.owner ? `${status.owner} owns the gripper` : "nobody owns the gripper");
  showFaults(status);
}

const HOST_FAULTS = {
  "NO DEVICE": "the microcontroller is away: check its cable and power",
  "NO STATUS": "the microcontroller says nothing: check its cable and power",
  "LATE FRAME": "a picture came too late and was dropped: check the load of the host",
};

let shownFaults = "";
function showFaults({ faults, host_faults: hostFaults }) {
  const told = [
    ...faults.map(({ number: at, name, active, latched, what_to_do: what }) => [
      `${at} ${name}`,
      `${active ? "" : "gone; "}${latched ? "wait to be acknowledged; " : ""}${what}`,
    ]),
    ...hostFaults.map((name) => [name, HOST_FAULTS[name] ?? "see the log of the run"]),
  ];
  const key = JSON.stringify(told);
  if (key === shownFaults) return;
  shownFaults = key;
  const items = told.map(([name, what]) => {
    const item = document.createElement("li");
    const strong = document.createElement("b");
    strong.textContent = name;
    item.append(strong, ` ${what}`);
    return item;
  });
  if (!items.length) {
    const none = document.createElement("li");
    none.className = "none";
    none.textContent = "no fault";
    items.push(none);
  }
  byId("faults").replaceChildren(...items);
}

// The page's own connection comes first: without it nothing else is known.
export function showAlarm(isThere, status) {
  let text = "";
  if (isThere === false) {
    text = "NO CONNECTION to the run: what is shown is old. Check that it runs; this page connects again by itself.";
  } else if (status && (!status.is_connected || status.host_faults.includes("NO STATUS"))) {
    text = `LINK LOST: ${status.link || "the microcontroller"} is away. Check its cable and power.`;
  }
  const alarm = byId("alarm");
  alarm.hidden = !text;
  say(alarm, text);
  document.body.classList.toggle("is-stale", isThere === false);
}
