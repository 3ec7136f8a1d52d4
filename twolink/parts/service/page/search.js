// A search field above a long list of choices: typing keeps those that have all the words.

const MOST = 8; // lines of the list while it is searched

/** Give a select a search field, an input. Returns a function to call when its options have been replaced. */
export function searchable(select, input) {
  let groups = [];
  const refresh = () => {
    groups = [...select.children].map(group => [group, [...group.children]]);
    input.placeholder = `Search ${select.options.length}`;
    input.hidden = select.options.length < MOST;
    input.value = "";
    select.size = 0;
  };
  const show = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    const value = select.value;
    const fits = option => {
      const text = `${option.textContent} ${option.value}`.toLowerCase();
      return words.every(word => text.includes(word));
    };
    const kept = groups.map(([group, options]) => [group, options.filter(fits)]).filter(([, options]) => options.length);
    for (const [group, options] of kept) group.replaceChildren(...options);
    select.replaceChildren(...kept.map(([group]) => group));
    select.value = value;
    select.size = words.length ? Math.min(MOST, Math.max(2, select.options.length + kept.length)) : 0;
    input.setAttribute("aria-label", `Search: ${select.options.length} found`);
  };
  const pick = value => {
    select.value = value;
    select.dispatchEvent(new Event("change"));
  };
  input.addEventListener("input", show);
  input.addEventListener("keydown", event => {
    if (event.key === "Enter" && input.value && select.options.length) pick(select.options[0].value);
    else if (event.key === "ArrowDown" && select.options.length) select.focus();
    else if (event.key === "Escape") input.value = "";
    else return;
    event.preventDefault();
    if (event.key === "Escape") show();
  });
  select.addEventListener("change", () => {
    if (!input.value) return;
    input.value = "";
    show();
  });
  refresh();
  return refresh;
}
