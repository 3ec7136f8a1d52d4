// The query form: any query at one state, its answer, and the same call from other programs.

import { get, hasToken, post } from "./api.js";
import { byId, clearProblem, el, short, showProblem } from "./dom.js";

export class QueryForm {
  /** getQ(): the configuration that the sliders show. */
  constructor(getQ) {
    this.getQ = getQ;
    byId("query-name").addEventListener("change", () => this.#fields());
    byId("query").addEventListener("submit", event => {
      event.preventDefault();
      this.#send();
    });
    byId("query-fields").addEventListener("input", () => this.#codes());
    byId("query-copy-q").addEventListener("click", () => {
      this.#write("q", this.getQ());
      this.#codes();
    });
    for (const button of document.querySelectorAll("[data-copy]")) {
      button.addEventListener("click", () => copy(button, byId(button.dataset.copy).textContent));
    }
  }

  /** Learn the queries that there are. */
  async list() {
    const rows = (await get("/v1/queries")).filter(query => query.method);
    this.queries = Object.fromEntries(rows.map(query => [query.name, query]));
    byId("query-name").replaceChildren(...rows.map(({ name }) => el("option", { value: name }, name.replaceAll("-", " "))));
  }

  set(robot) {
    this.robot = robot;
    clearProblem(byId("query-problem"));
    byId("query-answer").replaceChildren();
    this.values = {};
    this.#fields();
  }

  #fields() {
    const { summary, options } = this.query;
    byId("query-about").textContent = summary;
    const size = { q: this.robot.nq };
    const fields = Object.keys(this.query.arguments).map(name => {
      const initial = this.values[name] ?? numbers(name === "q" ? this.getQ() : Array(this.robot.nv).fill(0));
      const input = el("input", {
        id: `in-${name}`,
        value: initial,
        spellcheck: false,
        autocomplete: "off",
        inputMode: "text",
      });
      input.addEventListener("input", () => {
        this.values[name] = input.value;
      });
      return el(
        "label",
        { className: "field" },
        el("span", {}, el("b", {}, name), el("span", { className: "hint" }, ` ${size[name] ?? this.robot.nv} numbers`)),
        input,
      );
    });
    for (const [name, { about, choices }] of this.#chosen()) {
      const offered = choices.map(choice => el("option", {}, String(choice)));
      const hint = el("span", { className: "hint" }, ` ${about}`);
      const select = el("select", { id: `in-${name}` }, ...offered);
      fields.push(el("label", { className: "field" }, el("span", {}, el("b", {}, name), hint), select));
    }
    if (options.f_ext) {
      const frames = el(
        "select",
        { id: "in-wrench-frame" },
        el("option", { value: "" }, "none"),
        ...this.robot.links.map(link => el("option", {}, link)),
      );
      const values = el("input", { id: "in-wrench", value: "0 0 0 0 0 0", spellcheck: false, autocomplete: "off" });
      values.setAttribute("aria-label", "Force and moment, six numbers");
      const wrenchField = el(
        "label",
        { className: "field", hidden: true },
        el("span", {}, el("span", { className: "hint" }, "fx fy fz, tx ty tz")),
        values,
      );
      frames.addEventListener("change", () => {
        wrenchField.hidden = frames.value === "";
        this.#codes();
      });
      fields.push(
        el(
          "label",
          { className: "field" },
          el(
            "span",
            {},
            el("b", {}, "f_ext"),
            el("span", { className: "hint" }, " at a link's origin, along its axes"),
          ),
          frames,
        ),
        wrenchField,
      );
    }
    byId("query-fields").replaceChildren(...fields);
    this.#codes();
  }

  get name() {
    return byId("query-name").value;
  }

  get query() {
    return this.queries[this.name];
  }

  /** The options of which one of a few is chosen. */
  #chosen() {
    const options = Object.entries(this.query.options);
    const rows = options.map(([name, each]) => [name, name === "frame" ? { ...each, choices: this.robot.links } : each]);
    return rows.filter(([, { choices }]) => choices.length > 0);
  }

  #write(name, values) {
    this.values[name] = numbers(values);
    byId(`in-${name}`).value = this.values[name];
  }

  /** The body as typed. Throws an Error that names the field that is no list of numbers. */
  #body() {
    const body = {};
    const read = (name, id) => {
      const words = byId(id)
        .value.trim()
        .split(/[\s,;[\]]+/)
        .filter(Boolean);
      const values = words.map(Number);
      const wrong = words[values.findIndex(x => !Number.isFinite(x))];
      if (wrong !== undefined)
        throw Object.assign(new Error(`${name}: "${wrong}" is not a number`), {
          where: name,
          remedy: "Write numbers with blanks or commas between them.",
          id,
        });
      return values;
    };
    for (const name of Object.keys(this.query.arguments)) body[name] = read(name, `in-${name}`);
    for (const [name, { choices }] of this.#chosen()) {
      const choice = choices[byId(`in-${name}`).selectedIndex];
      if (choice !== false) body[name] = choice;
    }
    if (this.query.options.f_ext && byId("in-wrench-frame").value)
      body.f_ext = { [byId("in-wrench-frame").value]: read("f_ext", "in-wrench") };
    return body;
  }

  #codes() {
    let body;
    try {
      body = this.#body();
    } catch {
      return;
    } // sending says what is wrong
    const origin = new URL(".", location.href).href.replace(/\/$/, "");
    const address = `${origin}/v1/robots/${this.robot.id}/${this.name}`;
    const token = hasToken() ? ` \\\n  -H "Authorization: Bearer $TWOLINK_TOKEN"` : "";
    byId("curl").textContent =
      `curl -s ${address} \\\n  -H 'Content-Type: application/json'${token} \\\n  -d '${JSON.stringify(body).replaceAll("'", "'\\''")}'`;
    const connect = hasToken()
      ? `tl.connect("${origin}", token=os.environ["TWOLINK_TOKEN"])`
      : `tl.connect("${origin}")`;
    const head = `${hasToken() ? "import os\n\n" : ""}import twolink as tl\n\n`;
    const inputs = Object.entries(body)
      .map(([name, value]) => `${name}=${inPython(value)}`)
      .join(", ");
    byId("python").textContent = `${head}robot = ${connect}.robot("${this.robot.id}")\nprint(robot.${this.query.method}(${inputs}))`;
  }

  async #send() {
    const problem = byId("query-problem");
    clearProblem(problem);
    for (const input of byId("query-fields").querySelectorAll("input")) input.removeAttribute("aria-invalid");
    byId("query-send").disabled = true;
    try {
      const answer = await post(`/v1/robots/${encodeURIComponent(this.robot.id)}/${this.name}`, this.#body());
      byId("query-answer").replaceChildren(...show(answer, this.query.results));
    } catch (failure) {
      byId("query-answer").replaceChildren();
      const field = byId(failure.id ?? `in-${(failure.where ?? "").split("[")[0]}`);
      field?.setAttribute("aria-invalid", "true");
      showProblem(problem, failure);
    } finally {
      byId("query-send").disabled = false;
    }
  }
}

function numbers(values) {
  return values.map(x => Number(Number(x).toPrecision(6))).join(" ");
}

function inPython(value) {
  return typeof value === "boolean" ? (value ? "True" : "False") : JSON.stringify(value);
}

async function copy(button, text) {
  const before = button.textContent;
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = "Copied";
  } catch {
    // no clipboard without https: select it, so that Ctrl-C does it
    getSelection().selectAllChildren(button.closest("figure").querySelector("code"));
    button.textContent = "Selected: Ctrl-C";
  }
  setTimeout(() => {
    button.textContent = before;
  }, 2000);
}

/** Numbers as tables: a vector in a row, a matrix in rows. */
function show(answer, results) {
  const heads = answer.frames;
  return Object.entries(answer)
    .filter(([name]) => name !== "frames")
    .map(([name, value]) => {
      const rows = !Array.isArray(value) ? [[value]] : Array.isArray(value[0]) ? value : [value];
      const table = el(
        "table",
        { className: "numbers" },
        el("caption", {}, results[name].unit ? `${name} [${results[name].unit}]` : name),
        el(
          "tbody",
          {},
          ...rows.map((row, i) =>
            el(
              "tr",
              {},
              heads ? el("th", { scope: "row" }, heads[i]) : null,
              ...row.map(x => el("td", { title: String(x) }, short(x, 6))),
            ),
          ),
        ),
      );
      return el("div", { className: "scroll", tabIndex: 0, role: "region", "aria-label": name }, table);
    });
}
