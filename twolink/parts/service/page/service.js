// The service: ask for a token when it needs one, and say when it is gone.

import { onTokenWanted, setToken } from "./api.js";
import { announce, byId } from "./dom.js";

const AGAIN = 2000; // ms between two questions whether it is back

/** Watch the service; onBack() when it answers again. */
export function watchService(onBack) {
  onTokenWanted(askForToken);
  byId("token-button").addEventListener("click", () => {
    setToken("");
    location.reload();
  });
  let watching = false;
  addEventListener("service-gone", async () => {
    if (watching) return;
    watching = true;
    const banner = byId("banner");
    banner.textContent =
      "The service does not answer. Is “twolink serve” still running? What is shown here stays; this page goes on when it is back.";
    banner.hidden = false;
    do await new Promise(wait => setTimeout(wait, AGAIN));
    while (!(await isBack()));
    watching = false;
    banner.hidden = true;
    announce("The service answers again.");
    onBack();
  });
}

async function isBack() {
  try {
    return (await fetch("health")).ok;
  } catch {
    return false;
  }
}

function askForToken() {
  return new Promise(done => {
    const dialog = byId("token-dialog");
    byId("token").value = "";
    byId("token-button").hidden = false;
    dialog.addEventListener("close", () => done(dialog.returnValue === "ok" ? byId("token").value.trim() : null), {
      once: true,
    });
    dialog.returnValue = "cancel";
    dialog.showModal();
  });
}
