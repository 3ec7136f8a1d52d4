// Small helpers: elements, problems as text, numbers as text.

export const byId = id => document.getElementById(id);

/** An element. Properties that begin with "on" are listeners, "data-", "aria-" and "role" are attributes. */
export function el(kind, properties = {}, ...children) {
  const element = document.createElement(kind);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (/^(aria-|data-|role$|for$|colspan$|scope$)/.test(name)) element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children.filter(child => child !== null && child !== undefined));
  return element;
}

/** Announce a text to screen readers. */
export function announce(text) {
  byId("announce").textContent = text;
}

export function clearProblem(host) {
  host.replaceChildren();
}

/** What the service says to programs, as a person at the page says it. */
function plainly(text) {
  return text
    .replace(/\(GET \/v1\/\w+ lists [^)]*\)/g, "(the list has them)")
    .replace(/GET \/v1\/\w+ lists( the)? \w+/g, "choose one of the list")
    .replace(/POST \/v1\/robots with other options gives another id/g, "load it again with other options")
    .replace(/say which: \?urdf=\S+/g, "choose one of them")
    .replace(/\s*\((?:error\.run|tl\.)[^)]*\)/g, "")
    .replace(/\bpatience=\S+, or (\w)/g, (_, next) => next)
    .replace(/\b(accuracy|precision|method|duration|step|tolerance|contact)=["']?([^\s,;)"']+)["']?/g, "$1 $2")
    .replace(/Expected `(?:float|int)` (>=?) ([\d.]+)/, (_, sign, least) => `a number ${sign === ">" ? "above" : "not below"} ${Number(least)} is needed`)
    .replace(/Expected `(?:float|int)`, got `(\w+)`/, (_, got) => `a number is needed, not ${got}`)
    .replace(/Expected `(\w+)`, got `(\w+)`/, (_, wanted, got) => `${wanted} is needed, not ${got}`)
    .replaceAll("`", "");
}

/** Show a problem in an element: what is wrong, where, and what to do. */
export function showProblem(host, problem) {
  if (problem.name === "AbortError") return;
  if (!("remedy" in problem)) console.warn(problem); // a fault of this page, not an answer of the service
  const what = plainly(problem.message || String(problem));
  const box = el("div", { className: "problem", role: "alert" }, el("p", { className: "what" }, sentence(what)));
  const where = /^(scene|body|(path|query|header)\b.*|)$/.test(problem.where ?? "") ? "" : problem.where;
  if (where) box.append(el("p", {}, el("span", { className: "hint" }, "At "), el("code", {}, where)));
  if (problem.remedy && !problem.remedy.endsWith("/docs")) {
    box.append(el("p", {}, el("span", { className: "hint" }, "What to do: "), sentence(plainly(problem.remedy))));
  }
  host.replaceChildren(box);
  box.scrollIntoView({ block: "nearest" });
}

export function sentence(text) {
  const first = text.slice(0, 1);
  const begun = /^[a-z]+\b(?!=)/.test(text) ? first.toUpperCase() + text.slice(1) : text;
  return /[.!?]$/.test(begun) ? begun : `${begun}.`;
}

/** A table that scrolls where it is wide. rows: texts; those of columns `words` stand left. */
export function table(caption, heads, rows, words = [0]) {
  const cell = (text, i) => el("td", { className: words.includes(i) ? "words" : "" }, text);
  const head = (text, i) => el("th", { scope: "col", className: words.includes(i) ? "words" : "" }, text);
  const content = el(
    "table",
    { className: "numbers" },
    el("caption", {}, caption),
    el("thead", {}, el("tr", {}, ...heads.map(head))),
    el("tbody", {}, ...rows.map(row => el("tr", {}, ...row.map(cell)))),
  );
  return el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": caption }, content);
}

/** 0.00031 -> "310 µs" */
export function seconds(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "?";
  if (value === 0) return "0 s";
  if (value >= 120) return `${short(value / 60, 2)} min`;
  for (const [unit, size] of [
    ["s", 1],
    ["ms", 1e-3],
    ["µs", 1e-6],
  ]) {
    if (value >= size * 0.9995) return `${short(value / size, 2)} ${unit}`;
  }
  return `${short(value / 1e-9, 2)} ns`;
}

/** A number in few characters, with a true minus sign. */
export function short(value, digits = 3) {
  if (value === null || value === undefined) return "";
  if (!Number.isFinite(value)) return String(value);
  const size = Math.abs(value);
  let text = String(Number(value.toPrecision(digits)));
  if (size !== 0 && (size < 1e-4 || size >= 1e6)) text = power(value, digits);
  else if (size >= 10 ** digits) text = String(Math.round(value));
  return text.replace(/^-/, "−");
}

function power(value, digits) {
  const [mantissa, exponent] = value.toExponential(Math.max(0, digits - 1)).split("e");
  return `${Number(mantissa)}e${Number(exponent)}`;
}

export function count(number, one, many = `${one}s`) {
  return `${number} ${number === 1 ? one : many}`;
}

/** Call `act` at most once in `wait` ms, after the last call. */
export function debounce(act, wait) {
  let timer = 0;
  return (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => act(...values), wait);
  };
}

/** Tabs by the ARIA pattern: arrows move, the panel follows. */
export function wireTabs(list, onShow = () => {}) {
  const tabs = [...list.querySelectorAll("[role=tab]")];
  const show = (tab, focus) => {
    for (const other of tabs) {
      const chosen = other === tab;
      other.setAttribute("aria-selected", String(chosen));
      other.tabIndex = chosen ? 0 : -1;
      byId(other.getAttribute("aria-controls")).hidden = !chosen;
    }
    if (focus) tab.focus();
    onShow(tab.id);
  };
  tabs.forEach((tab, i) => {
    tab.addEventListener("click", () => show(tab, false));
    tab.addEventListener("keydown", event => {
      const next = { ArrowRight: i + 1, ArrowLeft: i - 1, Home: 0, End: tabs.length - 1 }[event.key];
      if (next === undefined) return;
      event.preventDefault();
      show(tabs[(next + tabs.length) % tabs.length], true);
    });
  });
}
