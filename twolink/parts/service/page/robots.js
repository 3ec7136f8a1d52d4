// The choice of the robot: the list, uploads with their options, and the load report.

import { get, getOnce, post, request } from "./api.js";
import { announce, byId, clearProblem, count, el, short, showProblem } from "./dom.js";
import { filesIn, zipOf } from "./folder.js";
import { searchable } from "./search.js";

const TITLES = {
  suspicious: ["Suspicious", "used as it is, though it looks wrong"],
  read: ["Read", "what the file says"],
  ignored: ["Ignored", "in the file, but not in the answers"],
  repaired: ["Repaired", "changed, because it cannot be right"],
  assumed: ["Assumed", "not in the file"],
};

export class Robots {
  /** onRobot(robot, changes) is called when another was picked or uploaded; changes: those given to `pick`. */
  constructor(onRobot) {
    this.onRobot = onRobot;
    this.file = null; // what was uploaded last, to load it again with other options
    this.turn = 0;
    this.usual = new Map(); // the root with which each robot of the catalogue is meant to be used
    this.select = byId("robot-select");
    this.select.addEventListener("change", () => this.pick(this.select.value));
    this.searched = searchable(this.select, byId("robot-search"));
    byId("file").addEventListener("change", event => {
      if (event.target.files.length) this.upload(event.target.files[0]);
      event.target.value = "";
    });
    for (const id of ["root", "mimic", "unphysical"]) byId(id).addEventListener("change", () => this.#again());
    this.#drops();
  }

  #options() {
    const options = {};
    if (byId("root").value !== "fixed") options.root = byId("root").value;
    if (byId("mimic").checked) options.mimic = true;
    if (byId("unphysical").checked) options.unphysical = "report";
    return options;
  }

  /** Fill the list. */
  async list() {
    const robots = await get("/v1/robots");
    const group = (label, members) =>
      el(
        "optgroup",
        { label },
        ...members.map(robot => el("option", { value: robot.id }, titleOf(robot, members))),
      );
    this.usual = new Map(robots.map(robot => [robot.id, robot.usual_root]));
    const uploaded = robots.filter(robot => robot.origin === "uploaded");
    const shipped = robots.filter(robot => robot.from === "twolink");
    const others = robots.filter(robot => robot.origin === "catalogue" && robot.from !== "twolink");
    this.select.replaceChildren(
      ...[
        ["Uploaded", uploaded],
        ["twolink", shipped],
        ["example-robot-data", others],
      ]
        .filter(([, members]) => members.length)
        .map(([label, members]) => group(label, members)),
    );
    this.searched();
    if (this.robot) this.select.value = this.robot.id;
  }

  /** A robot of the list, with the options that are set; another one than before begins with its usual root. */
  async pick(id, changes = {}) {
    if (!this.usual.size) await this.list();
    const usual = this.usual.get(id);
    if (id !== this.source && usual) byId("root").value = usual;
    const options = id.startsWith("u-") ? {} : this.#options();
    this.file = null;
    await this.#take(
      Object.keys(options).length || usual === "free" // in an address a name means the usual root
        ? () => post("/v1/robots", { source: id, ...options })
        : () => this.#named(id),
      { picked: id, changes },
    );
  }

  /** The robot that a scene names. Throws Problem. */
  async ofScene(entry) {
    const turn = ++this.turn;
    const { source, root, lock } = typeof entry === "string" ? { source: entry } : entry;
    const isOther = root === "free" || Object.keys(lock ?? {}).length;
    const robot = await (isOther ? post("/v1/robots", entry) : this.#named(source));
    if (turn !== this.turn) return null;
    this.source = source;
    await this.show(robot);
    return robot;
  }

  /** urdf: which file of a zip is the robot. */
  async upload(file, urdf = "") {
    this.file = file;
    const query = new URLSearchParams({ ...this.#options(), ...(urdf && { urdf }) }).toString();
    const type = /\.zip$/i.test(file.name) || file.type.includes("zip") ? "application/zip" : "application/xml";
    await this.#take(
      async () => {
        const answer = await request(`/v1/robots${query && `?${query}`}`, {
          method: "POST",
          body: file,
          headers: { "Content-Type": type },
        });
        return answer.json();
      },
      { uploaded: true },
    );
  }

  /** What a robot is made of in a folder that was dropped. */
  async #uploadFolder(entry) {
    byId("robot-facts").textContent = `Reading the folder ${entry.name}…`;
    try {
      await this.upload(await zipOf(await filesIn(entry), entry.name));
    } catch (failure) {
      showProblem(byId("robot-problem"), failure); // a file in it cannot be read
    }
  }

  /** Offer the robots of a zip. */
  #chooseUrdf(problem, urdfs) {
    const buttons = urdfs.map(name => el("button", { type: "button", onclick: () => this.upload(this.file, name) }, name));
    problem.firstChild.append(el("p", {}, "Which of them?"), el("p", { className: "buttons choices" }, ...buttons));
  }

  async #again() {
    if (this.file) await this.upload(this.file);
    else if (this.source && !this.source.startsWith("u-")) await this.pick(this.source);
  }

  async #take(load, { picked = null, uploaded = false, changes = {} }) {
    const turn = ++this.turn;
    const problem = byId("robot-problem");
    clearProblem(problem);
    byId("drop").setAttribute("aria-busy", "true");
    byId("robot-facts").textContent = uploaded ? "Loading the upload…" : "Loading…";
    try {
      const robot = await load();
      if (turn !== this.turn) return;
      this.source = picked ?? robot.id;
      await this.show(robot, uploaded);
      await this.onRobot(robot, changes);
    } catch (failure) {
      if (turn !== this.turn) return;
      if (uploaded) failure.where = failure.where?.replace("URDF text", this.file.name);
      showProblem(problem, failure);
      if (failure.code === "several-urdfs") this.#chooseUrdf(problem, failure.data.urdfs);
      byId("robot-facts").textContent = this.robot ? `Still ${this.robot.name}: ${facts(this.robot)}` : "";
      if (this.robot) this.select.value = this.robot.id;
      byId("root").value = this.robot?.root ?? "fixed";
    } finally {
      if (turn === this.turn) byId("drop").removeAttribute("aria-busy");
    }
  }

  /** Name the robot and say how it was loaded. */
  async show(robot, uploaded = false) {
    this.robot = robot;
    clearProblem(byId("robot-problem"));
    if (![...this.select.options].some(option => option.value === robot.id)) await this.list();
    this.select.value = robot.id;
    byId("root").value = robot.root ?? "fixed";
    byId("robot-facts").textContent = `${robot.name}: ${facts(robot)}`;
    this.#report(robot.report, uploaded);
    if (uploaded) announce(`${robot.name} is loaded`);
  }

  #report(report, open) {
    const sizes = Object.keys(TITLES)
      .filter(key => report[key]?.length)
      .map(key => `${report[key].length} ${TITLES[key][0].toLowerCase()}`);
    byId("report").hidden = false;
    byId("report-summary").replaceChildren("Load report ", el("span", { className: "hint" }, sizes.join(" · ")));
    byId("report").open = false;
    byId("report-body").replaceChildren(
      ...Object.entries(TITLES)
        .filter(([key]) => report[key]?.length)
        .map(([key, [title, about]]) =>
          el(
            "section",
            { className: `report-${key}` },
            el("h3", {}, title, el("span", { className: "hint" }, ` ${about}`)),
            el("ul", {}, ...report[key].map(entry => el("li", {}, entry.what, names(entry.names)))),
          ),
        ),
    );
    if (open && (report.suspicious?.length || report.repaired.length || report.ignored.length)) byId("report").open = true;
  }

  /** A robot as the service has it; what it looks like takes longest, and is asked for at once. */
  #named(id) {
    this.look(id).catch(() => {});
    return get(`/v1/robots/${encodeURIComponent(id)}`);
  }

  /** What a robot looks like. */
  look(id) {
    return getOnce(`/v1/robots/${encodeURIComponent(id)}/visuals`);
  }

  #drops() {
    const cover = byId("dropping");
    let depth = 0;
    const files = event => [...(event.dataTransfer?.types ?? [])].includes("Files");
    const over = value => {
      cover.hidden = !value;
      if (!value) depth = 0;
    };
    addEventListener("dragenter", event => {
      if (files(event)) {
        depth++;
        over(true);
      }
    });
    addEventListener("dragleave", () => {
      if (--depth <= 0) over(false);
    });
    addEventListener("dragover", event => {
      if (files(event)) event.preventDefault();
    });
    addEventListener("drop", event => {
      over(false);
      if (!files(event)) return;
      event.preventDefault();
      const entry = event.dataTransfer.items[0]?.webkitGetAsEntry?.();
      if (entry?.isDirectory) this.#uploadFolder(entry);
      else if (event.dataTransfer.files.length) this.upload(event.dataTransfer.files[0]);
    });
  }
}

/** An uploaded robot's name, with what sets it apart from others of that name. */
function titleOf(robot, members) {
  if (robot.origin !== "uploaded") return robot.name;
  const locked = Object.keys(robot.lock ?? {}).length;
  const words = [robot.root === "free" ? "free base" : "", locked ? `${count(locked, "joint")} locked` : ""];
  const twin = other => other.name === robot.name && other.root === robot.root && other !== robot;
  if (members.some(twin) && !locked) words.push(robot.id.slice(0, 6));
  const about = words.filter(Boolean).join(", ");
  return about ? `${robot.name} (${about})` : robot.name;
}

function facts(robot) {
  const root = robot.root === "free" ? ", free base" : "";
  return `${count(robot.joints.length, "joint")}, ${count(robot.links.length, "link")}, ${short(robot.mass)} kg${root}`;
}

function names(all) {
  if (!all.length) return "";
  const shown = all.slice(0, 6).join(", ");
  if (all.length <= 6) return el("span", { className: "names" }, ` ${shown}`);
  return el("span", { className: "names", title: all.join(", ") }, ` ${shown} and ${all.length - 6} more`);
}
