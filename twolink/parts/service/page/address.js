// The page's address after "#": the robot or scene, what was changed of it, and the runs shown. Who has the address has
// the page: it can be sent, reloaded and gone back from. Without "#" it is ?robot=NAME or ?scene=NAME, for links by hand.

/** {robot, scene, changes, run, compared}. changes: see SceneEditor; null where they cannot be read. */
export function readAddress() {
  const parts = new URLSearchParams(location.hash.slice(1) || location.search);
  let changes = {};
  try {
    changes = JSON.parse(parts.get("changes") ?? "{}");
  } catch {
    changes = null;
  }
  const compared = (parts.get("compare") ?? "").split(",").filter(Boolean);
  return { robot: parts.get("robot"), scene: parts.get("scene"), changes, run: parts.get("run"), compared };
}

/** Write the address. step: a new step of the browser's history, to which "back" returns. */
export function writeAddress({ robot, scene, changes = {}, run = null, compared = [] }, step = false) {
  const parts = new URLSearchParams();
  if (scene) parts.set("scene", scene);
  else if (robot) parts.set("robot", robot);
  if (Object.keys(changes).length) parts.set("changes", JSON.stringify(changes));
  if (run) parts.set("run", run);
  if (compared.length) parts.set("compare", compared.join(","));
  const hash = `#${parts}`;
  if (hash === location.hash) return;
  if (step) history.pushState(null, "", hash);
  else history.replaceState(null, "", hash);
}
