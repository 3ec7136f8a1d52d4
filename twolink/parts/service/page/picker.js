// A list of quantities to search and tick: masses, gains, start positions.

import { count, el, short } from "./dom.js";

const LISTED = 60; // at most, while nothing is searched for

export class Picker {
  /** most: how many may be ticked. onChange(): the choice has changed. */
  constructor({ label, most, onChange = () => {} }) {
    Object.assign(this, { most, onChange, rows: [], chosen: new Set() });
    this.summary = el("p", { className: "facts", "aria-live": "polite" });
    this.search = el("input", { type: "search", placeholder: "Search quantities", "aria-label": `Search: ${label}` });
    this.search.addEventListener("input", () => this.#draw());
    this.list = el("ul", { className: "picker", "aria-label": label });
    this.node = el("div", {}, this.search, this.list, this.summary);
  }

  /** Offer rows {name, unit, value, about}; chosen: names that are ticked at first. */
  set(rows, chosen) {
    this.rows = rows;
    const known = new Set(rows.map(row => row.name));
    this.chosen = new Set(chosen.filter(name => known.has(name)).slice(0, this.most));
    this.#draw();
  }

  get names() {
    return [...this.chosen];
  }

  #draw() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = row => words.every(word => `${row.name} ${row.about}`.toLowerCase().includes(word));
    const found = this.rows.filter(row => this.chosen.has(row.name) || fits(row));
    const first = found.sort((a, b) => this.chosen.has(b.name) - this.chosen.has(a.name)).slice(0, LISTED);
    this.list.replaceChildren(...first.map(row => this.#row(row)));
    const more = found.length - first.length;
    this.summary.textContent =
      `${this.chosen.size} of at most ${this.most} chosen` + (more > 0 ? `; ${count(more, "more", "more")}: search for them` : "");
  }

  #row(row) {
    const box = el("input", { type: "checkbox", checked: this.chosen.has(row.name) });
    box.disabled = !box.checked && this.chosen.size >= this.most;
    box.addEventListener("change", () => {
      if (box.checked) this.chosen.add(row.name);
      else this.chosen.delete(row.name);
      const full = this.chosen.size >= this.most;
      for (const other of this.list.querySelectorAll("input")) other.disabled = full && !other.checked;
      this.summary.textContent = `${this.chosen.size} of at most ${this.most} chosen`;
      this.onChange();
    });
    const value = row.value === null ? "" : ` ${short(row.value)} ${row.unit === "SI units" ? "" : row.unit}`;
    return el("li", {}, el("label", { className: "check", title: row.about }, box, row.name, el("span", { className: "hint" }, value)));
  }
}
