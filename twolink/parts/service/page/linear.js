// The scene's equations near a state: eigenvalues in the complex plane, what they mean, and the matrices.

import { post } from "./api.js";
import { ticks } from "./axes.js";
import { byId, clearProblem, el, seconds, short, showProblem, table } from "./dom.js";

const WIDTH = 420,
  HEIGHT = 300,
  EDGE = 34; // px
const NAMESPACE = "http://www.w3.org/2000/svg";

export class Linear {
  /** getRequest(): the settings of a run. getState(): {q, v} that the controls show. */
  constructor(getRequest, getState) {
    this.problem = el("div", { id: "linear-problem" });
    this.result = el("div", { id: "linear-result" });
    const button = el("button", { type: "button", className: "primary", id: "linear-button" }, "Linearize");
    button.addEventListener("click", async () => {
      button.disabled = true;
      clearProblem(this.problem);
      try {
        const { q, v } = getState();
        this.#show(await post("/v1/scenes/linearize", { scene: getRequest().scene, q, v }));
      } catch (failure) {
        this.result.replaceChildren();
        showProblem(this.problem, failure);
      } finally {
        button.disabled = false;
      }
    });
    byId("panel-linear").append(
      el(
        "p",
        { className: "hint" },
        "dx/dt = A x + B u near the state that the sliders show, with the effects of the scene above. At an equilibrium the eigenvalues of A tell whether it stays.",
      ),
      el("p", { className: "buttons" }, button),
      this.problem,
      this.result,
    );
  }

  #show(answer) {
    const { A, B, names, inputs, eigenvalues, eigenvalue_errors: errors, equilibrium, stability, controllable } = answer;
    const rows = eigenvalues.map(([real, imaginary], i) => {
      const fades = real === 0 ? "" : `${real < 0 ? "fades" : "grows"} in ${seconds(1 / Math.abs(real))}`;
      const turns = imaginary === 0 ? "" : `${short(Math.abs(imaginary) / (2 * Math.PI), 3)} Hz`;
      const sign = imaginary < 0 ? "−" : "+";
      const known = part => (Math.abs(part) > errors[i] ? short(part, 5) : "0"); // what its error hides is not shown
      const value = imaginary === 0 ? known(real) : `${known(real)} ${sign} ${known(Math.abs(imaginary))} i`;
      return [value, `± ${short(errors[i], 2)}`, Math.abs(real) > errors[i] ? fades : "", turns];
    });
    const matrix = (name, values, columns) =>
      table(
        `${name}: a row for each of ${names.length} states`,
        ["", ...columns],
        values.map((row, i) => [names[i], ...row.map(x => short(x, 5))]),
      );
    const verdict = equilibrium
      ? `An equilibrium: ${stability}.`
      : "No equilibrium: the eigenvalues tell of neighbours of the motion here, not of rest.";
    const reach = inputs.length ? ` Torques on ${inputs.length} joints control ${controllable} of ${names.length} states.` : "";
    this.result.replaceChildren(
      el("p", { id: "linear-verdict" }, el("b", {}, verdict), reach),
      el(
        "div",
        { className: "halves" },
        complexPlane(eigenvalues, errors),
        table("Eigenvalues, 1/s", ["Value", "Error", "", "Frequency"], rows, []),
      ),
      el("details", {}, el("summary", {}, "A and B"), matrix("A", A, names), inputs.length ? matrix("B", B, inputs) : ""),
    );
  }
}

function svg(kind, attributes, ...children) {
  const element = document.createElementNS(NAMESPACE, kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** Eigenvalues with their errors as discs; right of the axis they grow. */
function complexPlane(values, errors) {
  const reach = part => Math.max(...values.map(value => Math.abs(value[part]))) * 1.15;
  const whole = Math.max(reach(0), reach(1)) || 1;
  const [wide, high] = [Math.max(reach(0), 0.3 * whole), Math.max(reach(1), 0.3 * whole)];
  const x = real => WIDTH / 2 + (real / wide) * (WIDTH / 2 - EDGE);
  const y = imaginary => HEIGHT / 2 - (imaginary / high) * (HEIGHT / 2 - EDGE);
  const text = (at, words, anchor = "middle") => svg("text", { x: at[0], y: at[1], "text-anchor": anchor }, words);
  const parts = [
    svg("rect", { class: "grows", x: x(0), y: 0, width: WIDTH - x(0), height: HEIGHT }),
    svg("line", { x1: 0, x2: WIDTH, y1: y(0), y2: y(0) }),
    svg("line", { x1: x(0), x2: x(0), y1: 0, y2: HEIGHT }),
  ];
  for (const tick of ticks(-wide, wide, 4)) if (tick) parts.push(text([x(tick), y(0) + 15], short(tick)));
  for (const tick of ticks(-high, high, 4)) if (tick) parts.push(text([x(0) - 6, y(tick) + 4], short(tick), "end"));
  parts.push(text([WIDTH - 6, y(0) - 8], "real, 1/s", "end"), text([x(0) + 6, 13], "imaginary, 1/s", "start"));
  parts.push(text([WIDTH - 6, HEIGHT - 8], "grows", "end"), text([6, HEIGHT - 8], "fades", "start"));
  values.forEach(([real, imaginary], i) => {
    const far = [(errors[i] / wide) * (WIDTH / 2 - EDGE), (errors[i] / high) * (HEIGHT / 2 - EDGE)];
    const [rx, ry] = far.map(size => Math.min(Math.max(size, 0), WIDTH));
    parts.push(svg("ellipse", { class: "error", cx: x(real), cy: y(imaginary), rx, ry }));
    parts.push(svg("circle", { class: real > errors[i] ? "value bad" : "value", cx: x(real), cy: y(imaginary), r: 4.5 }));
  });
  const label = `Eigenvalues: ${values.map(([real, imaginary]) => `${short(real)} ${short(imaginary)} i`).join("; ")}`;
  return svg("svg", { class: "plane", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": label }, ...parts);
}
