// The query form: any query at one state, its answer, and the same call from other programs.

import { hasToken, post } from "./api.js";
import { byId, clearProblem, el, short, showProblem } from "./dom.js";

// inputs: after q. python: the client's method, or null when it has none. about: shown to the user.
const QUERIES = {
  "forward-dynamics": {
    inputs: ["v", "tau"],
    wrench: true,
    python: "forward_dynamics",
    about: "Accelerations a of M(q) a + h(q, v) = tau.",
  },
  "inverse-dynamics": {
    inputs: ["v", "a"],
    wrench: true,
    python: "inverse_dynamics",
    about: "Torques tau = M(q) a + h(q, v).",
  },
  "mass-matrix": { inputs: [], python: "mass_matrix", about: "The joint-space inertia matrix M(q)." },
  bias: { inputs: ["v"], python: "bias", about: "h(q, v): Coriolis, centrifugal and gravity torques." },
  coriolis: {
    inputs: ["v"],
    python: "coriolis",
    about: "A matrix C(q, v) with C v the Coriolis and centrifugal torques.",
  },
  "gravity-torque": { inputs: [], python: "gravity_torque", about: "The torques that hold the robot at rest against gravity." },
  energy: { inputs: ["v"], python: "energy", about: "Kinetic and potential energy, J." },
  kinematics: { inputs: [], python: "link_poses", about: "Where each link is: position in m, quaternion x y z w." },
  derivatives: {
    inputs: ["v", "tau"],
    python: "forward_dynamics_derivatives",
    about: "Derivatives of the accelerations with respect to q, v and tau.",
  },
};

export class QueryForm {
  /** getQ(): the configuration that the sliders show. */
  constructor(getQ) {
    this.getQ = getQ;
    const select = byId("query-name");
    select.append(...Object.keys(QUERIES).map(name => el("option", { value: name }, name.replaceAll("-", " "))));
    select.addEventListener("change", () => this.#fields());
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

  set(robot) {
    this.robot = robot;
    clearProblem(byId("query-problem"));
    byId("query-answer").replaceChildren();
    this.values = {};
    this.#fields();
  }

  #fields() {
    const { inputs, wrench, about } = QUERIES[this.name];
    byId("query-about").textContent = about;
    const size = { q: this.robot.nq };
    const fields = ["q", ...inputs].map(name => {
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
    if (wrench) {
      const frames = el(
        "select",
        { id: "in-frame" },
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
    for (const name of ["q", ...QUERIES[this.name].inputs]) body[name] = read(name, `in-${name}`);
    if (QUERIES[this.name].wrench && byId("in-frame").value)
      body.f_ext = { [byId("in-frame").value]: read("f_ext", "in-wrench") };
    return body;
  }

  #codes() {
    let body;
    try {
      body = this.#body();
    } catch {
      return;
    } // sending says what is wrong
    const address = `${location.origin}/v1/robots/${this.robot.id}/${this.name}`;
    const token = hasToken() ? ` \\\n  -H "Authorization: Bearer $TWOLINK_TOKEN"` : "";
    byId("curl").textContent =
      `curl -s ${address} \\\n  -H 'Content-Type: application/json'${token} \\\n  -d '${JSON.stringify(body).replaceAll("'", "'\\''")}'`;
    const { python } = QUERIES[this.name];
    const connect = hasToken()
      ? `tl.connect("${location.origin}", token=os.environ["TWOLINK_TOKEN"])`
      : `tl.connect("${location.origin}")`;
    const head = `${hasToken() ? "import os\n\n" : ""}import twolink as tl\n\n`;
    const inputs = Object.entries(body)
      .map(([name, value]) => `${name}=${JSON.stringify(value)}`)
      .join(", ");
    byId("python").textContent = python
      ? `${head}robot = ${connect}.robot("${this.robot.id}")\nprint(robot.${python}(${inputs}))`
      : `import httpx\n\nbody = ${JSON.stringify(body)}\nprint(httpx.post("${address}", json=body).json())`;
  }

  async #send() {
    const problem = byId("query-problem");
    clearProblem(problem);
    for (const input of byId("query-fields").querySelectorAll("input")) input.removeAttribute("aria-invalid");
    byId("query-send").disabled = true;
    try {
      const answer = await post(`/v1/robots/${encodeURIComponent(this.robot.id)}/${this.name}`, this.#body());
      byId("query-answer").replaceChildren(...show(answer));
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
function show(answer) {
  const heads = answer.frames;
  return Object.entries(answer)
    .filter(([name]) => name !== "frames")
    .map(([name, value]) => {
      const rows = !Array.isArray(value) ? [[value]] : Array.isArray(value[0]) ? value : [value];
      const table = el(
        "table",
        { className: "numbers" },
        el("caption", {}, name),
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
