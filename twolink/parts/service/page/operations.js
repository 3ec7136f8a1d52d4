// Any other function of the package, on the scene above: its form is made from the API's description, its answer is tables.

import { downloadButton, get, getOnce } from "./api.js";
import { byId, count, el, short, table } from "./dom.js";
import { fields } from "./form.js";
import { Job, jobControls } from "./jobs.js";

const LONG = 200; // rows of a table that is shown

export class Operations {
  /** getScene(): the scene above. getNames(): of forms. getRobot(): the robot above. */
  constructor(getScene, getNames, getRobot) {
    Object.assign(this, { getScene, getNames, getRobot });
    this.select = el("select", { id: "operation-name" });
    this.select.addEventListener("change", () => this.#form());
    this.form = el("div", { id: "operation-form" });
    const { node, parts } = jobControls("operation", "Compute");
    this.result = el("div", { id: "operation-result" });
    byId("panel-operation").append(
      el("p", { className: "hint" }, "Other functions of the package, for the scene and the robot above; what is left as it is has its default."),
      el("label", { className: "row" }, "Function ", this.select),
      this.form,
      node,
      this.result,
    );
    this.job = new Job("operations", parts, job => this.#show(job, parts));
    parts.start.addEventListener("click", () => {
      const { scene, properties } = this.#chosen();
      const robot = properties.robot ? { robot: this.getRobot().id } : {};
      const scenes = Object.fromEntries(scene.map(name => [name, this.getScene()]));
      this.job.run({ operation: this.select.value, ...scenes, ...robot, ...this.values });
    });
  }

  /** Learn which functions there are, and the quantities of the scene. */
  async set(rows) {
    const [{ paths, components }, listed] = await Promise.all([getOnce("/openapi.json"), get("/v1/robots")]);
    const { anyOf } = paths["/v1/operations"].post.requestBody.content["application/json"].schema;
    this.schemas = Object.fromEntries(
      anyOf.map(({ $ref }) => components.schemas[$ref.split("/").at(-1)]).map(schema => [schema.properties.operation.enum[0], schema]),
    );
    const robots = [this.getRobot().id, ...listed.map(({ id }) => id)];
    this.names = { ...this.getNames(), defs: components.schemas, quantities: rows.map(row => row.name), robots };
    const before = this.select.value;
    this.select.replaceChildren(...Object.keys(this.schemas).map(name => el("option", { value: name }, name.replaceAll("_", " "))));
    if (before) this.select.value = before;
    else this.#form();
  }

  /** The chosen function: its parameters, and those of them that are scenes. */
  #chosen() {
    const { properties, required } = this.schemas[this.select.value];
    const isScene = part => part.anyOf?.some(({ $ref }) => $ref?.endsWith("/SceneFile"));
    return { properties, required, scene: Object.keys(properties).filter(name => isScene(properties[name])) };
  }

  #form() {
    const { properties, required, scene } = this.#chosen();
    this.values = {};
    const left = new Set([...scene, "wait", "robot"]);
    const asked = Object.fromEntries(Object.entries(properties).filter(([name]) => !left.has(name)));
    const schema = { properties: asked, required };
    this.form.replaceChildren(fields(schema, {}, to => (this.values = to), this.names, this.select.value.replaceAll("_", " ")));
    this.result.replaceChildren();
  }

  #show(job, parts) {
    const name = `${this.select.value}-${job.id.slice(-6)}.json`;
    const all = downloadButton("JSON", `/v1/operations/${job.id}`, name, parts.problem);
    this.result.replaceChildren(...shown(job.result), el("p", { className: "downloads" }, el("span", { className: "hint" }, "Download "), all));
  }
}

/** Have an element that opens hold the form of some fields of a request. type: of the request. */
export function settingsForm(details, type, names, value, set, label) {
  details.addEventListener("toggle", async () => {
    if (!details.open || details.children.length > 1) return;
    const { schemas } = (await getOnce("/openapi.json")).components;
    const properties = Object.fromEntries(names.map(name => [name, schemas[type].properties[name]]));
    details.append(fields({ properties }, value, set, { defs: schemas }, label));
  });
}

const isPlain = value => value === null || typeof value !== "object";
const said = value => (typeof value === "number" ? short(value, 6) : Array.isArray(value) ? value.map(said).join(", ") : String(value ?? ""));

/** A record as elements: what is one value in a table, lists in tables of their own, records within it behind their names. */
function shown(record) {
  const entries = Object.entries(record);
  const words = ([name, value]) => [name.replaceAll("_", " "), said(value)];
  const single = entries.filter(([, value]) => isPlain(value));
  const parts = single.length ? [table("What was found", ["", ""], single.map(words), [0, 1])] : [];
  for (const [name, value] of entries.filter(([, value]) => !isPlain(value))) {
    const title = name.replaceAll("_", " ");
    if (!Array.isArray(value)) parts.push(el("details", {}, el("summary", {}, title), ...shown(value)));
    else if (value.length) parts.push(listed(title, value));
  }
  return parts;
}

function listed(title, rows) {
  const head = `${title}${rows.length > LONG ? `: the first ${LONG} of ${count(rows.length, "row")}` : ""}`;
  const first = rows.slice(0, LONG);
  if (first.every(isPlain)) return table(head, first.map((_, i) => String(i)), [first.map(said)], []);
  if (first.every(Array.isArray)) return table(head, first[0].map((_, i) => String(i)), first.map(row => row.map(said)), []);
  const heads = Object.keys(first[0]);
  return table(head, heads.map(each => each.replaceAll("_", " ")), first.map(row => heads.map(each => said(row[each]))), [0]);
}
