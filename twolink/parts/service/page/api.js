// Requests to the service with fetch: JSON, problems as exceptions, streams of events, downloads.

import { el, showProblem } from "./dom.js";

export class Problem extends Error {
  constructor(content) {
    super(content.detail || content.title || "it did not work");
    Object.assign(this, { status: 0, where: "", remedy: "", code: "", data: {}, ...content });
  }
}

const KEY = "twolink-token";
let token = sessionStorage.getItem(KEY) || "";
let asking = null; // one question for a token at a time
let ask = async () => null;

/** Set how the user is asked for a token: an async function that returns one, or null. */
export function onTokenWanted(question) {
  ask = question;
}

export function hasToken() {
  return token !== "";
}

export function setToken(value) {
  token = value;
  sessionStorage.setItem(KEY, value);
}

async function wantToken() {
  asking ??= ask().finally(() => {
    asking = null;
  });
  const answer = await asking;
  if (answer) setToken(answer);
  return Boolean(answer);
}

/** A path of the service, from where its page is: a proxy may have put it below another path. */
function below(path) {
  return path.replace(/^\//, "");
}

/** The answer to a request. Throws Problem unless its status is 2xx; asks for a token when the service needs one. */
export async function request(path, { method = "GET", body, headers = {}, signal } = {}) {
  for (let attempt = 0; ; attempt++) {
    const all = token ? { ...headers, Authorization: `Bearer ${token}` } : headers;
    let answer;
    try {
      answer = await fetch(below(path), { method, headers: all, signal, ...(body !== undefined && { body }) });
    } catch (failure) {
      if (failure.name === "AbortError") throw failure;
      window.dispatchEvent(new Event("service-gone"));
      throw new Problem({
        detail: "The service does not answer.",
        gone: true,
        remedy: "Is twolink serve still running? This page notices when it is back.",
      });
    }
    if (answer.ok) return answer;
    if (answer.status === 401 && attempt < 3 && (await wantToken())) continue;
    throw await problemOf(answer);
  }
}

/** A WebSocket of the service. Browsers send no header with it: the token is a subprotocol, as base64url. */
export function socket(path) {
  const url = new URL(below(path), location.href.replace(/^http/, "ws"));
  const coded = btoa(token).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
  return new WebSocket(url, token ? ["bearer", coded] : []);
}

async function problemOf(answer) {
  try {
    return new Problem(await answer.json());
  } catch {
    return new Problem({
      status: answer.status,
      detail: "The service could not answer this.",
      remedy: "Try it again in a moment.",
    });
  }
}

export async function get(path, options) {
  return (await request(path, options)).json();
}

const kept = new Map();

/** What is the same whenever it is asked for: asked for once. */
export function getOnce(path) {
  if (!kept.has(path)) {
    kept.set(path, get(path));
    kept.get(path).catch(() => kept.delete(path)); // the next one may ask again
  }
  return kept.get(path);
}

export async function post(path, content, options = {}) {
  const headers = { "Content-Type": "application/json" };
  return (await request(path, { ...options, method: "POST", body: JSON.stringify(content), headers })).json();
}

/** Server-sent events, read with fetch because EventSource cannot send a token. */
export async function* events(path, signal) {
  const answer = await request(path, { signal, headers: { Accept: "text/event-stream" } });
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let buffer = "";
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      buffer += value.replaceAll("\r", "");
      const blocks = buffer.split("\n\n");
      buffer = blocks.pop();
      for (const block of blocks) {
        const lines = block.split("\n");
        const part = name =>
          lines
            .filter(x => x.startsWith(name))
            .map(x => x.slice(name.length).trim())
            .join("\n");
        if (part("data:")) yield { event: part("event:") || "message", data: JSON.parse(part("data:")) };
      }
    }
  } finally {
    reader.cancel().catch(() => {});
  }
}

/** Save the answer of a path as a file. */
async function download(path, name) {
  const address = URL.createObjectURL(await (await request(path)).blob());
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

/** A button that saves the answer of a path as a file of this name; host: where its problem is shown. */
export function downloadButton(text, path, name, host) {
  const save = () => download(path, name).catch(failure => showProblem(host, failure));
  return el("button", { type: "button", className: "quiet", onclick: save }, text);
}
