// The list of a scene's effects: each with its switch, its values in a form, and what it costs.

import { el, sentence, short } from "./dom.js";
import { fields } from "./form.js";

/** Fill the list. effects: [{content, on}], which get their elements: row, about, price, bar. names: of forms.
 *
 * onChange(): a value or a switch has changed. onRemove(effect): it is to go. */
export function listEffects(host, effects, names, { onChange, onRemove }) {
  const rows = effects.map(effect => {
    const title = titleOf(effect.content.type);
    effect.price = el("span", { className: "price" });
    effect.bar = el("span", { className: "bar" });
    effect.about = el("span", { className: "about" }, wordsOf(effect.content));
    const box = el("input", { type: "checkbox", role: "switch", checked: effect.on });
    box.addEventListener("change", () => {
      effect.on = box.checked;
      effect.row.classList.toggle("off", !effect.on);
      onChange();
    });
    effect.row = el(
      "li",
      { className: effect.on ? "" : "off" },
      el("label", {}, box, el("span", { className: "effect-name" }, title), effect.about),
      el(
        "span",
        { className: "cost", title: "operations an evaluation" },
        effect.price,
        el("span", { className: "track" }, effect.bar),
      ),
      valuesOf(effect, names, title, onChange, onRemove),
    );
    return effect.row;
  });
  host.replaceChildren(...(rows.length ? rows : [el("li", { className: "hint" }, "None: nothing acts on it.")]));
}

/** The form of an effect, made when it is opened. */
function valuesOf(effect, names, title, onChange, onRemove) {
  const details = el("details", { className: "values", open: effect.open === true });
  const fill = () => {
    effect.open = details.open;
    if (!details.open || details.children.length > 1) return;
    const schema = names.effects[effect.content.type];
    const change = content => {
      effect.content = content;
      effect.about.textContent = wordsOf(content);
      onChange();
    };
    const form = schema
      ? fields(schema, effect.content, change, names, title)
      : el("p", { className: "hint" }, "It has no form: see the scene as JSON.");
    const equation = schema?.description ? el("pre", { className: "equation", tabIndex: 0 }, schema.description) : null;
    const remove = el(
      "button",
      { type: "button", className: "quiet", onclick: () => onRemove(effect) },
      `Remove ${title.toLowerCase()}`,
    );
    details.append(...[equation, form, remove].filter(Boolean));
  };
  details.append(el("summary", { "aria-label": `Values of ${title}` }, "Values"));
  details.addEventListener("toggle", fill);
  if (details.open) fill();
  return details;
}

export function titleOf(type) {
  return sentence(type.replaceAll("-", " ").replace(/\bpd\b/, "PD")).slice(0, -1);
}

/** The values of an effect in one line. */
export function wordsOf(content) {
  const say = value => {
    if (typeof value === "number") return short(value);
    if (Array.isArray(value)) return `(${value.map(say).join(", ")})`;
    if (value && typeof value === "object") {
      return Object.entries(value)
        .filter(([key]) => key !== "kind")
        .map(([key, item]) => `${key} ${say(item)}`)
        .join(", ");
    }
    return String(value);
  };
  return Object.entries(content)
    .filter(([key]) => key !== "type")
    .map(([key, value]) => `${key} ${say(value)}`)
    .join(" · ");
}
