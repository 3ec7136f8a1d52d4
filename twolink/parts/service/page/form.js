// A form for a value that a JSON Schema describes: the fields of an effect. Each control hands on the new value.

import { el } from "./dom.js";

/** An editor of a value: an element. set(value) is called with each new value.
 *
 * names: {defs, joints, links, constants}: the schema's definitions, and the names that its formats stand for. label: of
 * the value, for screen readers. */
export function editor(schema, value, set, names, label) {
  const kinds = variants(schema, names);
  if (kinds.length > 1) return choice(kinds, value, set, names, label);
  return plainEditor(kinds[0], value, set, names, label);
}

/** The fields of an object, each with its name and what the schema says of it. */
export function fields(schema, value, set, names, label = "") {
  const current = { ...value };
  const own = Object.entries(schema.properties).filter(([name]) => !isTag(name, schema.properties[name]));
  const rows = own.map(([name, part]) => {
    const change = to => {
      if (to === undefined) delete current[name];
      else current[name] = to;
      set({ ...current });
    };
    const shown = name in current ? current[name] : part.default;
    return el(
      "div",
      { className: "part" },
      el("span", { className: "part-name", title: aboutOf(part) }, name.replaceAll("_", " ")),
      editor(part, shown, change, names, `${label} ${name}`.trim()),
      part.description ? el("p", { className: "hint part-about" }, aboutOf(part)) : null,
    );
  });
  return el("div", { className: "form" }, ...rows);
}

/** The joints that a field takes: those of one degree of freedom, or of one coordinate. */
const jointsOf = (schema, names) => (schema?.freedom === "coordinate" ? names.coordinates : names.joints);

/** A value to begin with. */
export function initial(schema, names) {
  const [part] = variants(schema, names);
  if (part.default !== undefined) return part.default;
  switch (kindOf(part)) {
    case "null":
      return null;
    case "number":
      return part.minimum ?? (part.exclusiveMinimum === 0 ? 1 : 0);
    case "boolean":
      return false;
    case "enum":
      return part.enum[0];
    case "string":
      return { link: names.links.at(-1), joint: jointsOf(part, names)[0] }[part.format] ?? "";
    case "tuple":
      return part.prefixItems.map(item => initial(item, names));
    case "list":
      return [];
    case "map":
      return {};
    case "fields": {
      const needed = Object.entries(part.properties).filter(
        ([name, field]) => isTag(name, field) || part.required?.includes(name),
      );
      return Object.fromEntries(needed.map(([name, field]) => [name, initial(field, names)]));
    }
    default:
      return null;
  }
}

function aboutOf(part) {
  return (part.description ?? "").replaceAll("`", "");
}

function isTag(name, part) {
  return ["type", "kind"].includes(name) && part.enum?.length === 1;
}

/** The schema's alternatives, references followed. Quantities of joints are edited as numbers, not as texts with a unit. */
function variants(schema, names) {
  if (schema.$ref) return variants({ ...names.defs[schema.$ref.split("/").at(-1)], ...omit(schema, "$ref") }, names);
  if (!schema.anyOf) return [schema];
  const parts = schema.quantity ? schema.anyOf.filter(part => part.type !== "string") : schema.anyOf;
  return parts.flatMap(part => variants({ minimum: schema.minimum, ...part }, names));
}

function omit(object, name) {
  const { [name]: _omitted, ...rest } = object;
  return rest;
}

function kindOf(schema) {
  if (schema.enum) return "enum";
  if (schema.type === "array") return schema.prefixItems ? "tuple" : schema.items?.type === "number" ? "list" : "json";
  if (schema.type === "object") return schema.properties ? "fields" : "map";
  if (schema.type === "integer") return "number";
  return ["null", "number", "boolean", "string"].includes(schema.type) ? schema.type : "json";
}

function fits(schema, value) {
  switch (kindOf(schema)) {
    case "null":
      return value === null || value === undefined;
    case "number":
      return typeof value === "number";
    case "boolean":
      return typeof value === "boolean";
    case "enum":
      return schema.enum.includes(value);
    case "string":
      return typeof value === "string";
    case "tuple":
    case "list":
      return Array.isArray(value);
    case "fields":
      return Object.entries(schema.properties).every(([name, part]) => !isTag(name, part) || value?.[name] === part.enum[0]);
    case "map":
      return value !== null && typeof value === "object" && !Array.isArray(value) && !("kind" in value);
    default:
      return true;
  }
}

/** What an alternative is called. */
function nameOf(schema) {
  switch (kindOf(schema)) {
    case "null":
      return "none";
    case "number":
      return "a number";
    case "enum":
      return schema.enum.join(", ");
    case "string":
      return "a name";
    case "map":
      return "by name";
    case "fields": {
      const tag = Object.entries(schema.properties).find(([name, part]) => isTag(name, part));
      return tag ? tag[1].enum[0].replaceAll("-", " ") : (schema.title ?? "values");
    }
    default:
      return "a list";
  }
}

/** A choice among alternatives, with the editor of the chosen one. */
function choice(kinds, value, set, names, label) {
  const place = el("span", { className: "choice" });
  let at = Math.max(0, kinds.findIndex(kind => fits(kind, value)));
  const select = el(
    "select",
    { "aria-label": `${label}: kind` },
    ...kinds.map((kind, i) => el("option", { value: i, selected: i === at }, nameOf(kind))),
  );
  const show = current => {
    const single = kindOf(kinds[at]) === "null" || (kindOf(kinds[at]) === "enum" && kinds[at].enum.length === 1);
    place.replaceChildren(select, ...(single ? [] : [plainEditor(kinds[at], current, set, names, label)]));
  };
  select.addEventListener("change", () => {
    at = Number(select.value);
    const first = initial(kinds[at], names);
    show(first);
    set(first);
  });
  show(value);
  return place;
}

function plainEditor(schema, value, set, names, label) {
  switch (kindOf(schema)) {
    case "number":
      return (schema.type === "integer" ? numberInput : numberSlider)(value, set, label, schema.minimum ?? schema.exclusiveMinimum);
    case "boolean": {
      const box = el("input", { type: "checkbox", checked: value === true, "aria-label": label });
      box.addEventListener("change", () => set(box.checked));
      return box;
    }
    case "enum":
      return options(schema.enum, value, set, label);
    case "string":
      return { link: () => options([...names.links, ...(schema.ground ? ["universe"] : [])], value, set, label) }[schema.format]?.() ??
        { joint: () => options(jointsOf(schema, names), value, set, label) }[schema.format]?.() ??
        textInput(value ?? "", set, label, text => text);
    case "tuple":
      return tuple(schema, value, set, names, label);
    case "list":
      return textInput((value ?? []).join(" "), set, label, numbersOf);
    case "map":
      return map(schema, value ?? {}, set, names, label);
    case "fields":
      return fields(schema, value ?? initial(schema, names), set, names, label);
    default:
      return textInput(JSON.stringify(value ?? null), set, label, JSON.parse);
  }
}

export function numberInput(value, set, label, least) {
  const input = el("input", { type: "number", step: "any", value: value ?? "", "aria-label": label });
  if (Number.isFinite(least)) input.min = least;
  input.addEventListener("input", () => {
    const wrong = input.value === "" || !Number.isFinite(Number(input.value)) || Number(input.value) < (least ?? -Infinity);
    input.setAttribute("aria-invalid", String(wrong));
    if (!wrong) set(Number(input.value));
  });
  return input;
}

/** A number with a slider below it, which reaches as far as the number on either side. */
export function numberSlider(value, set, label, least = -Infinity) {
  const [middle, reach] = [value ?? 0, Math.abs(value) || 1];
  const range = el("input", { type: "range", min: Math.max(least, middle - reach), max: middle + reach, step: reach / 200 });
  range.setAttribute("aria-label", `${label}, slider`);
  range.value = middle;
  const input = numberInput(value, set, label, least);
  input.addEventListener("input", event => event.isTrusted && (range.value = input.value));
  range.addEventListener("input", () => {
    input.value = Number(Number(range.value).toPrecision(3));
    input.dispatchEvent(new Event("input"));
  });
  return el("span", { className: "number" }, input, range);
}

/** A text whose meaning read(text) gives; read throws where it has none. */
function textInput(text, set, label, read) {
  const input = el("input", { type: "text", value: text, spellcheck: false, autocomplete: "off", "aria-label": label });
  input.addEventListener("change", () => {
    try {
      set(read(input.value));
      input.setAttribute("aria-invalid", "false");
    } catch {
      input.setAttribute("aria-invalid", "true");
    }
  });
  return input;
}

function numbersOf(text) {
  const numbers = text
    .split(/[\s,;]+/)
    .filter(Boolean)
    .map(Number);
  if (!numbers.every(Number.isFinite)) throw new Error("not numbers");
  return numbers;
}

function options(all, value, set, label) {
  const known = all.includes(value) || value === undefined ? all : [value, ...all];
  const select = el("select", { "aria-label": label }, ...known.map(name => el("option", {}, name)));
  if (value !== undefined) select.value = value;
  select.addEventListener("change", () => set(select.value));
  return select;
}

function tuple(schema, value, set, names, label) {
  const current = [...(value ?? schema.prefixItems.map(item => initial(item, names)))];
  const axes = current.length === 3 ? ["x", "y", "z"] : current.length === 6 ? ["xx", "xy", "xz", "yy", "yz", "zz"] : null;
  const parts = schema.prefixItems.map((item, i) =>
    editor(
      item,
      current[i],
      to => {
        current[i] = to;
        set([...current]);
      },
      names,
      `${label} ${axes?.[i] ?? i + 1}`,
    ),
  );
  return el("span", { className: "tuple" }, ...parts);
}

/** Values by name: a line each, with a choice of names to add. */
function map(schema, value, set, names, label) {
  const known = schema.propertyNames?.format === "constant" ? Object.keys(names.constants) : jointsOf(schema.propertyNames, names);
  const current = { ...value };
  const place = el("span", { className: "map" });
  const changed = () => set({ ...current });
  const show = () => {
    const rows = Object.keys(current).map(name =>
      el(
        "span",
        { className: "map-row" },
        el("span", { className: "map-name", title: name }, name),
        editor(
          schema.additionalProperties,
          current[name],
          to => {
            current[name] = to;
            changed();
          },
          names,
          `${label} ${name}`,
        ),
        el(
          "button",
          {
            type: "button",
            className: "quiet remove",
            "aria-label": `Leave ${name} out of ${label}`,
            title: "Leave it out",
            onclick: () => {
              delete current[name];
              show();
              changed();
            },
          },
          "×",
        ),
      ),
    );
    const left = known.filter(name => !(name in current));
    const add = el(
      "select",
      { className: "map-add", "aria-label": `Add to ${label}` },
      el("option", { value: "" }, "Add…"),
      ...left.map(name => el("option", {}, name)),
    );
    add.addEventListener("change", () => {
      current[add.value] = names.constants[add.value] ?? initial(schema.additionalProperties, names);
      show();
      changed();
    });
    place.replaceChildren(...rows, ...(left.length ? [add] : []));
  };
  show();
  return place;
}
