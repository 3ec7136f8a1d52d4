// Which joints' curves are shown: a list to search and tick, for robots with many.

import { count, el } from "./dom.js";

const FIRST = 8; // joints at first: those that move most

export class CurveChoice {
  /** onChange(shown): a set of names of joints. */
  constructor(host, onChange) {
    this.host = host;
    this.onChange = onChange;
    this.shown = new Set();
  }

  /** Offer joints by name, those that move most first. The choice stays where the joints are the same. */
  set(names) {
    const same = this.names?.length === names.length && names.every(name => this.names.includes(name));
    this.names = names;
    if (!same) this.shown = new Set(names.slice(0, FIRST));
    this.host.hidden = names.length <= FIRST;
    if (!this.host.hidden && !same) this.#draw();
  }

  #draw() {
    const summary = el("summary");
    const say = () => {
      summary.textContent = `Curves: ${this.shown.size} of ${count(this.names.length, "joint")}`;
    };
    const boxes = this.names.map(name => {
      const box = el("input", { type: "checkbox", checked: this.shown.has(name) });
      box.addEventListener("change", () => {
        if (box.checked) this.shown.add(name);
        else this.shown.delete(name);
        say();
        this.onChange();
      });
      return { name, box, row: el("li", {}, el("label", { className: "check" }, box, ` ${name}`)) };
    });
    const tick = keep => () => {
      this.shown = new Set(this.names.filter(keep));
      for (const { name, box } of boxes) box.checked = this.shown.has(name);
      say();
      this.onChange();
    };
    const search = el("input", { type: "search", placeholder: "Search joints", "aria-label": "Search joints" });
    search.addEventListener("input", () => {
      for (const { name, row } of boxes) row.hidden = !name.toLowerCase().includes(search.value.toLowerCase());
    });
    const button = (text, keep) => el("button", { type: "button", onclick: tick(keep) }, text);
    const most = new Set(this.names.slice(0, FIRST));
    say();
    this.host.replaceChildren(
      summary,
      el(
        "p",
        { className: "buttons" },
        search,
        button("Those that move most", name => most.has(name)),
        button("All", () => true),
        button("None", () => false),
      ),
      el("ul", { className: "curve-list" }, ...boxes.map(({ row }) => row)),
    );
  }
}
