// Controls for one value of a form. set(value) is called with each new value that is within bounds.

import { el } from "./dom.js";

const UNITS = { q: { rad: ["rad", "deg"], m: ["m", "mm"] }, v: { rad: ["rad/s", "deg/s"], m: ["m/s", "mm/s"] }, tau: { rad: ["N m"], m: ["N"] } };
const QUANTITY = /^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)\s*(.*?)\s*$/i;

/** The units of a quantity "q", "v" or "tau" of joints whose coordinates are "rad" or "m"; of either without kind. */
export function unitsOf(quantity, kind) {
  return Object.entries(UNITS[quantity] ?? {}).flatMap(([own, units]) => (!kind || kind === own ? units : []));
}

/** The bounds that a schema sets to a number, in words; "" without any. */
export function boundsOf({ type, minimum, exclusiveMinimum, maximum, exclusiveMaximum }) {
  const least = minimum ?? exclusiveMinimum;
  const most = maximum ?? exclusiveMaximum;
  const whole = type === "integer" ? ["a whole number"] : [];
  if (least !== undefined) whole.push(minimum === undefined ? `above ${least}` : `at least ${least}`);
  if (most !== undefined) whole.push(maximum === undefined ? `below ${most}` : `at most ${most}`);
  return whole.join(", ");
}

function within(number, { type, minimum, exclusiveMinimum, maximum, exclusiveMaximum }) {
  const bounded =
    number >= (minimum ?? -Infinity) && number > (exclusiveMinimum ?? -Infinity) && number <= (maximum ?? Infinity) && number < (exclusiveMaximum ?? Infinity);
  return Number.isFinite(number) && bounded && (type !== "integer" || Number.isInteger(number));
}

/** A number. schema: with its bounds. */
export function numberInput(value, set, label, schema = {}) {
  const input = el("input", { type: "number", step: schema.type === "integer" ? 1 : "any", value: value ?? "", title: boundsOf(schema), "aria-label": label });
  const [min, max] = [schema.minimum ?? schema.exclusiveMinimum, schema.maximum ?? schema.exclusiveMaximum];
  Object.assign(input, min === undefined ? {} : { min }, max === undefined ? {} : { max });
  input.addEventListener("input", () => {
    const right = input.value !== "" && within(Number(input.value), schema);
    input.setAttribute("aria-invalid", String(!right));
    if (right) set(Number(input.value));
  });
  return input;
}

/** A number, or a text of a number and one of `units`; the number alone is in SI units. */
function quantityInput(value, set, label, schema, units) {
  const input = el("input", { type: "text", inputMode: "decimal", value: value ?? "", spellcheck: false, autocomplete: "off", "aria-label": label });
  input.title = [`a number, or with a unit: ${units.join(", ")}`, boundsOf(schema)].filter(Boolean).join("; ");
  input.addEventListener("input", () => {
    const [, number, unit] = QUANTITY.exec(input.value) ?? [];
    const right = number !== undefined && within(Number(number), schema) && ["", ...units].includes(unit);
    input.setAttribute("aria-invalid", String(!right));
    if (right) set(unit ? `${Number(number)} ${unit}` : Number(number));
  });
  return input;
}

/** A number with a slider below it, which reaches as far as the number on either side. units: that may stand behind it. */
export function numberSlider(value, set, label, schema = {}, units = []) {
  const [, number = 0, unit = ""] = QUANTITY.exec(value ?? 0) ?? [];
  const [middle, reach] = [Number(number), Math.abs(number) || 1];
  const [least, most] = [schema.minimum ?? schema.exclusiveMinimum ?? -Infinity, schema.maximum ?? schema.exclusiveMaximum ?? Infinity];
  const range = el("input", { type: "range", min: Math.max(least, middle - reach), max: Math.min(most, middle + reach), step: reach / 200 });
  range.setAttribute("aria-label", `${label}, slider`);
  range.value = middle;
  const input = units.length ? quantityInput(value, set, label, schema, units) : numberInput(value, set, label, schema);
  input.addEventListener("input", event => event.isTrusted && (range.value = Number.parseFloat(input.value)));
  range.addEventListener("input", () => {
    const shown = Number(Number(range.value).toPrecision(3));
    input.value = unit ? `${shown} ${unit}` : shown;
    input.dispatchEvent(new Event("input"));
  });
  return el("span", { className: "number" }, input, range);
}

/** A text whose meaning read(text) gives; read throws where it has none. known: names to offer. */
export function textInput(text, set, label, read, known = []) {
  const input = el("input", { type: "text", value: text, spellcheck: false, autocomplete: "off", "aria-label": label });
  input.addEventListener("change", () => {
    try {
      set(read(input.value));
      input.setAttribute("aria-invalid", "false");
    } catch {
      input.setAttribute("aria-invalid", "true");
    }
  });
  if (!known.length) return input;
  const list = el("datalist", { id: `known-${label.replaceAll(/\W+/g, "-")}` }, ...known.map(name => el("option", { value: name })));
  input.setAttribute("list", list.id);
  return el("span", { className: "number" }, input, list);
}

/** Numbers with blanks or commas between them; where there are several rows, semicolons. Throws where it is none. */
export function numbersOf(text) {
  const rows = text.split(/[;\n]/).map(row => row.split(/[\s,]+/).filter(Boolean).map(Number));
  if (!rows.flat().every(Number.isFinite)) throw new Error("not numbers");
  return rows.length > 1 ? rows.filter(row => row.length) : rows[0];
}

export function textOf(numbers) {
  return [numbers ?? []].flat().some(Array.isArray) ? numbers.map(row => row.join(" ")).join("; ") : [numbers ?? []].flat().join(" ");
}

/** One of a few values. */
export function options(all, value, set, label) {
  const known = all.includes(value) || value === undefined ? all : [value, ...all];
  const select = el("select", { "aria-label": label }, ...known.map(name => el("option", { value: String(name) }, String(name))));
  select.selectedIndex = Math.max(0, known.indexOf(value));
  select.addEventListener("change", () => set(known[select.selectedIndex]));
  return select;
}
