// A form for a value that a JSON Schema describes: the fields of an effect, of an operation. Each control hands on the new
// value.

import { el } from "./dom.js";
import { boundsOf, numberInput, numbersOf, numberSlider, options, textInput, textOf, unitsOf } from "./inputs.js";

/** An editor of a value: an element. set(value) is called with each new value.
 *
 * names: {defs, joints, coordinates, links, constants, units}: the schema's definitions, the names that its formats stand
 * for, and of joints "rad" or "m". quantities, robots: the names to offer in place of joints, and of robots. label: of the
 * value, for screen readers. */
export function editor(schema, value, set, names, label) {
  const kinds = variants(schema, names);
  if (kinds.length > 1) return choice(kinds, value, set, names, label);
  return plainEditor(kinds[0], value, set, names, label);
}

/** The fields of an object, each with its name and what the schema says of it. */
export function fields(schema, value, set, names, label = "") {
  const current = { ...value };
  const own = Object.entries(schema.properties).filter(([name, part]) => !isTag(name, part) && !isOpen(part));
  const places = {};
  const show = (name, part) => {
    const change = to => {
      if (to === undefined) delete current[name];
      else current[name] = to;
      for (const [other, about] of own) if (about.of === name) follow(other, about, Object.keys(to ?? {}));
      set({ ...current });
    };
    const offered = part.of ? { ...names, offered: Object.keys(current[part.of] ?? {}) } : names;
    const shown = name in current ? current[name] : part.default;
    places[name].replaceChildren(editor(part, shown, change, offered, `${label} ${name}`.trim()));
  };
  const follow = (name, part, keys) => {
    if (current[name] && part.of) {
      const kept = keys.filter(key => part.each || key in current[name]);
      const first = initial(part.additionalProperties, names);
      current[name] = Object.fromEntries(kept.map(key => [key, current[name][key] ?? first]));
    }
    show(name, part);
  };
  const rows = own.map(([name, part]) => {
    places[name] = el("span", { className: "part-value" });
    show(name, part);
    const about = [aboutOf(part), limitsOf(part, names)].filter(Boolean).join(" ");
    return el(
      "div",
      { className: "part" },
      el("span", { className: "part-name", title: aboutOf(part) }, name.replaceAll("_", " ")),
      places[name],
      about ? el("p", { className: "hint part-about" }, about) : null,
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
      return { link: names.links?.at(-1), joint: jointsOf(part, names)[0], robot: names.robots?.[0] }[part.format] ?? "";
    case "tuple":
      return itemsOf(part).map(item => initial(item, names));
    case "numbers":
    case "rows":
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
  return ["type", "kind", "operation"].includes(name) && part.enum?.length === 1;
}

/** Whether it may be anything: what only Python gives, such as a function. */
const isOpen = part => !["type", "enum", "anyOf", "$ref"].some(key => key in part);

/** The schemas of an array of a fixed length. */
const itemsOf = schema => schema.prefixItems ?? Array(schema.minItems).fill(schema.items);

/** The units and bounds of a field in words. */
function limitsOf(part, names) {
  const inner = variants(part.additionalProperties ?? part, names).find(each => boundsOf(each) || each.quantity) ?? {};
  const units = unitsOf(inner.quantity);
  const said = [units.length ? `in ${units.join(", ")}` : "", boundsOf(inner)].filter(Boolean).join("; ");
  return said && `(${said})`;
}

/** The schema's alternatives, references followed. A quantity of a joint is one of them, a number or a text with a unit. */
function variants(schema, names) {
  if (schema.$ref) return variants({ ...names.defs[schema.$ref.split("/").at(-1)], ...omit(schema, "$ref") }, names);
  if (!schema.anyOf) return [schema];
  const parts = schema.quantity ? schema.anyOf.filter(part => part.type !== "string") : schema.anyOf;
  const { quantity, minimum, exclusiveMinimum } = schema;
  const own = quantity ? { quantity, minimum, exclusiveMinimum } : {};
  return parts.flatMap(part => variants(part.type === "number" ? { ...own, ...part } : part, names));
}

function omit(object, name) {
  const { [name]: _omitted, ...rest } = object;
  return rest;
}

function kindOf(schema) {
  if (schema.enum) return "enum";
  if (schema.type === "array") {
    if (schema.prefixItems || (schema.minItems && schema.minItems === schema.maxItems)) return "tuple";
    return areNumbers(schema.items) ? "numbers" : schema.items ? "rows" : "json";
  }
  if (schema.type === "object") return schema.properties ? "fields" : "map";
  if (schema.type === "integer") return "number";
  return ["null", "number", "boolean", "string"].includes(schema.type) ? schema.type : "json";
}

/** Whether they are numbers, or rows of numbers. */
const areNumbers = items => items?.type === "number" || (items?.type === "array" && !items.minItems && areNumbers(items.items)) || Boolean(items?.anyOf?.every(areNumbers));

function fits(schema, value) {
  switch (kindOf(schema)) {
    case "null":
      return value === null || value === undefined;
    case "number":
      return typeof value === "number" || (schema.quantity && typeof value === "string");
    case "boolean":
      return typeof value === "boolean";
    case "enum":
      return schema.enum.includes(value);
    case "string":
      return typeof value === "string";
    case "tuple":
    case "rows":
      return Array.isArray(value);
    case "numbers":
      return Array.isArray(value) || typeof value === "number";
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
    case "numbers":
      return "numbers";
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
      if (schema.type === "integer") return numberInput(value, set, label, schema);
      return numberSlider(value, set, label, schema, unitsOf(schema.quantity, names.unit));
    case "boolean": {
      const box = el("input", { type: "checkbox", checked: value === true, "aria-label": label });
      box.addEventListener("change", () => set(box.checked));
      return box;
    }
    case "enum":
      return options(schema.enum, value, set, label);
    case "string":
      if (schema.format === "link") return options([...names.links, ...(schema.ground ? ["universe"] : [])], value, set, label);
      if (schema.format === "joint") return options(jointsOf(schema, names), value, set, label);
      return textInput(value ?? "", set, label, readAs(schema), schema.format === "robot" ? names.robots : names.quantities);
    case "tuple":
      return tuple(schema, value, set, names, label);
    case "numbers":
      return textInput(textOf(value), set, label, numbersOf);
    case "rows":
      return rows(schema, value ?? [], set, names, label);
    case "map":
      if (schema.format === "columns") return columns(set, label);
      return map(schema, value ?? {}, set, names, label);
    case "fields":
      return fields(schema, value ?? initial(schema, names), set, names, label);
    default:
      return el("span", { "data-json": "", "aria-label": label }, textInput(JSON.stringify(value ?? null), set, label, JSON.parse));
  }
}

function tuple(schema, value, set, names, label) {
  const items = itemsOf(schema);
  const current = [...(value ?? items.map(item => initial(item, names)))];
  const axes = current.length === 3 ? ["x", "y", "z"] : current.length === 6 ? ["xx", "xy", "xz", "yy", "yz", "zz"] : null;
  const parts = items.map((item, i) =>
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
  const { offered, ...inner } = names;
  const format = schema.propertyNames?.format;
  const own = { constant: Object.keys(names.constants ?? {}), link: names.links }[format];
  const known = offered ?? own ?? (format ? jointsOf(schema.propertyNames, names) : (names.quantities ?? jointsOf({}, names)));
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
          { ...inner, unit: names.units?.[name] },
          `${label} ${name}`,
        ),
        removal(`Leave ${name} out of ${label}`, () => {
          delete current[name];
          show();
          changed();
        }),
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
      current[add.value] = (format === "constant" && names.constants[add.value]) || initial(schema.additionalProperties, names);
      show();
      changed();
    });
    place.replaceChildren(...rows, ...(left.length ? [add] : []));
  };
  show();
  return place;
}

/** A list of values, each with an editor of its own. */
function rows(schema, value, set, names, label) {
  const current = [...value];
  const place = el("span", { className: "map" });
  const changed = () => set([...current]);
  const show = () => {
    const parts = current.map((item, i) => {
      const change = to => {
        current[i] = to;
        changed();
      };
      const out = () => {
        current.splice(i, 1);
        show();
        changed();
      };
      return el("span", { className: "list-row" }, editor(schema.items, item, change, names, `${label} ${i + 1}`), removal(`Leave ${i + 1} out of ${label}`, out));
    });
    const more = () => {
      current.push(initial(schema.items, names));
      show();
      changed();
    };
    const add = el("button", { type: "button", className: "quiet", "aria-label": `Add to ${label}`, onclick: more }, "Add");
    place.replaceChildren(...parts, ...(current.length < (schema.maxItems ?? Infinity) ? [add] : []));
  };
  show();
  return place;
}

/** Columns of numbers, from a CSV file with their names in its first line. */
function columns(set, label) {
  const input = el("input", { type: "file", accept: ".csv,text/csv", "aria-label": label });
  input.addEventListener("change", async () => {
    const [heads, ...lines] = (await input.files[0].text()).split(/\r?\n/).filter(line => line.trim()).map(line => line.split(","));
    set(Object.fromEntries(heads.map((head, i) => [head.trim(), lines.map(line => Number(line[i]))])));
  });
  return input;
}

function removal(label, act) {
  return el("button", { type: "button", className: "quiet remove", "aria-label": label, title: "Leave it out", onclick: act }, "×");
}

/** What a text means: itself, where it is as the schema's pattern says. */
function readAs({ pattern }) {
  return text => {
    if (pattern && !new RegExp(pattern, "u").test(text)) throw new Error(`not as ${pattern}`);
    return text;
  };
}
