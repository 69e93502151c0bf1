// The run's events: decoded, and a watch over whether they still come.

// Statuses come twice a second: after this time without any, what is shown is old.
const SILENCE_MS = 1500;
const TAXEL_BYTES = 8;
const N_PER_LSB = 1 / 4096;

const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));

// Taxels with a force: {index, inContact, slips, fx, fy, fz}, newtons.
export function taxels(base64) {
  const view = new DataView(bytes(base64).buffer);
  const all = [];
  for (let at = 0; at + TAXEL_BYTES <= view.byteLength; at += TAXEL_BYTES) {
    const number = view.getUint16(at, true);
    const [fx, fy, fz] = [2, 4, 6].map((part) => view.getInt16(at + part, true) * N_PER_LSB);
    all.push({ index: number & 0x3fff, inContact: (number & 0x4000) !== 0, slips: (number & 0x8000) !== 0, fx, fy, fz });
  }
  return all;
}

// Calls back with every frame, every status, and when the events stop and start again.
export function listen({ onFrame, onStatus, onPresence }) {
  let heard = performance.now();
  let isThere = null;
  const tell = (now) => {
    if (now !== isThere) {
      isThere = now;
      onPresence(now);
    }
  };
  let source = null;
  const open = () => {
    source?.close();
    source = new EventSource("events");
    source.addEventListener("frame", (event) => {
      heard = performance.now();
      const frame = JSON.parse(event.data);
      frame.taxels = taxels(frame.map);
      frame.pixels = frame.picture ? bytes(frame.picture) : null;
      tell(true);
      onFrame(frame);
    });
    source.addEventListener("status", (event) => {
      heard = performance.now();
      tell(true);
      onStatus(JSON.parse(event.data));
    });
  };
  open();
  setInterval(() => {
    if (performance.now() - heard < SILENCE_MS) return;
    tell(false);
    // A refused stream is not tried again by itself, and a dead network is not noticed.
    if (source.readyState === EventSource.CLOSED || performance.now() - heard > 3 * SILENCE_MS) {
      heard = performance.now() - SILENCE_MS;
      open();
    }
  }, 250);
}
