// meshcat's script for the viewer, under the policy of this page.

/** Load meshcat's script. It writes style rules for menus this page does not show, and the page's policy refuses
 * inline styles; so while it loads, elements for such rules are harmless ones. */
export async function loadMeshcat() {
  if (window.MeshCat) return;
  const create = document.createElement;
  document.createElement = function (name, ...rest) {
    if (String(name).toLowerCase() !== "style") return create.call(document, name, ...rest);
    return Object.assign(create.call(document, "meta"), { sheet: { insertRule() {} } });
  };
  try {
    await new Promise(done => {
      const script = create.call(document, "script");
      script.src = new URL("meshcat.js", import.meta.url);
      script.onload = script.onerror = done; // the viewer says when it is not there
      document.head.append(script);
    });
  } finally {
    delete document.createElement;
  }
}
