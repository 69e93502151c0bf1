// Requests: who asks, with which token, and every answer in words.

const ANSWERS_SHOWN = 4;
// Longer than the run takes for any answer.
const PATIENCE_MS = 6000;

const byId = (id) => document.getElementById(id);

// Survives a reload of the tab, not its end; a browser that keeps nothing is no failure.
const kept = {
  get(key) {
    try { return sessionStorage.getItem(`gripline.${key}`); } catch { return null; }
  },
  set(key, value) {
    try { sessionStorage.setItem(`gripline.${key}`, value); } catch { /* only until the reload */ }
  },
};

function takeTokenFromAddress() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!given) return;
  kept.set("token", given);
  byId("token").value = given;
  history.replaceState(null, "", location.pathname + location.search);
}

function newName() {
  const random = crypto.getRandomValues(new Uint16Array(1))[0];
  return `page-${random.toString(16).padStart(4, "0")}`;
}

function nextNumber() {
  const number = Math.max(Date.now(), Number(kept.get("request") ?? 0) + 1);
  kept.set("request", `${number}`);
  return number;
}

function tell(text, kind, item = document.createElement("li")) {
  item.textContent = text;
  item.className = kind;
  const list = byId("answers");
  if (!item.isConnected) list.prepend(item);
  while (list.children.length > ANSWERS_SHOWN) list.lastChild.remove();
  return item;
}

const WORDS = { set_floor: "set floor", take_over: "take over", rezero: "re-zero" };

async function ask(action, more = {}) {
  const word = WORDS[action] ?? action;
  const token = byId("token").value.trim();
  const client = byId("client").value.trim();
  if (!token) {
    byId("who").open = true;
    byId("token").focus();
    tell(`${word}: not asked, because a token is needed. It stands in the token file of the run.`, "refused");
    return;
  }
  const item = tell(`${word}: asked, waiting for the answer`, "asked");
  try {
    const response = await fetch("control", {
      method: "POST",
      headers: { Authorization: `Bearer ${token}`, "Content-Type": "application/json" },
      body: JSON.stringify({ client, request: nextNumber(), action, ...more }),
      signal: AbortSignal.timeout(PATIENCE_MS),
    });
    const answer = await response.json();
    if (response.status === 401) {
      byId("who").open = true;
      byId("token").focus();
      tell(`${word}: refused, wrong token. ${answer.message}`, "refused", item);
    } else if (answer.outcome === "done") {
      tell(`${word}: done in ${Math.round(answer.took_ms)} ms`, "done", item);
    } else {
      tell(`${word}: refused${answer.why ? ` (${answer.why})` : ""}. ${answer.message}`, "refused", item);
    }
  } catch {
    tell(`${word}: no answer came from the run. Look at the state: it may or may not have been carried out.`, "refused", item);
  }
}

export function startControl() {
  const [token, client] = [byId("token"), byId("client")];
  token.value = kept.get("token") ?? "";
  client.value = kept.get("client") ?? newName();
  kept.set("client", client.value);
  takeTokenFromAddress();
  window.addEventListener("hashchange", takeTokenFromAddress);
  byId("who").open = !token.value;
  token.addEventListener("input", () => kept.set("token", token.value.trim()));
  client.addEventListener("input", () => kept.set("client", client.value.trim()));
  for (const button of document.querySelectorAll("[data-action]")) {
    button.addEventListener("click", async () => {
      button.setAttribute("aria-busy", "true");
      await ask(button.dataset.action);
      button.removeAttribute("aria-busy");
    });
  }
  byId("floor-form").addEventListener("submit", (event) => {
    event.preventDefault();
    ask("set_floor", { floor_n: byId("floor").valueAsNumber });
  });
}
