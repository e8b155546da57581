// The rows of a batch's report: sorted, filtered, and made only as far as one has scrolled.
"use strict";
(() => {
  const AT_ONCE = 100;
  const COLUMNS = [
    { key: "rank", title: "worst first" },
    { key: "line", title: "line", number: true, digits: 0 },
    { key: "clip", title: "clip" },
    { key: "subject", title: "subject" },
    { key: "state", title: "state" },
    { key: "seconds", title: "seconds", number: true, digits: 1 },
    { key: "frames", title: "frames", number: true, digits: 0 },
    { key: "px", title: "error, px", number: true, digits: 1 },
    { key: "jitter", title: "jitter, mm/frame²", number: true, digits: 1 },
    { key: "suspicious", title: "suspicious places", number: true, digits: 0 },
    { key: "why", title: "what to look at" },
    { key: "command", title: "open" },
  ];
  const all = JSON.parse(document.getElementById("rows").textContent);
  all.forEach((row, index) => (row.rank = index));
  const columns = COLUMNS.filter((c) => c.key === "rank" || all.some((row) => row[c.key] !== undefined));
  let order = { key: "rank", down: false };
  let chosen = all;
  let made = 0;

  function element(name, attributes = {}, ...content) {
    const node = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    node.append(...content);
    return node;
  }

  const CELLS = {
    rank: (row) => {
      const cell = element("td", { class: "picture" });
      if (row.picture) cell.append(element("img", { src: row.picture, loading: "lazy", alt: "" }));
      return cell;
    },
    clip: (row) => element("td", {}, row.href ? element("a", { href: encodeURI(row.href) }, row.clip) : row.clip),
    state: (row) => element("td", { class: row.state.split(" ")[0] }, row.state),
    why: (row) => {
      const cell = element("td", { class: "why" }, row.why ?? "");
      if (row.notes) cell.append(element("details", {}, element("summary", {}, "notes"), element("p", {}, row.notes)));
      return cell;
    },
    command: (row) => {
      const cell = element("td");
      if (!row.command) return cell;
      const button = element("button", { class: "copy", type: "button", title: row.command }, "copy command");
      button.onclick = () => copy(row.command, button);
      cell.append(button);
      return cell;
    },
  };

  // A page that is opened as a file may not use the clipboard in every browser: the command is shown then.
  async function copy(text, button) {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = "copied";
    } catch {
      button.replaceWith(element("code", {}, text));
    }
  }

  function cellOf(row, column) {
    if (CELLS[column.key]) return CELLS[column.key](row);
    const value = row[column.key];
    if (!column.number) return element("td", {}, value ?? "");
    return element("td", { class: "n" }, value === undefined ? "–" : value.toFixed(column.digits));
  }

  const body = element("tbody");
  const end = element("div");
  const told = element("span", { class: "dim" });

  function more() {
    for (const row of chosen.slice(made, made + AT_ONCE)) {
      body.append(element("tr", {}, ...columns.map((column) => cellOf(row, column))));
    }
    made = Math.min(made + AT_ONCE, chosen.length);
    told.textContent = `${chosen.length} of ${all.length} clips`;
  }

  function compared(a, b) {
    const [one, other] = [a[order.key], b[order.key]];
    if (one === undefined || other === undefined) return (one === undefined) - (other === undefined);
    const difference = typeof one === "number" ? one - other : one.localeCompare(other, "en", { numeric: true });
    return (order.down ? -difference : difference) || a.rank - b.rank;
  }

  function draw() {
    const text = search.value.trim().toLowerCase();
    chosen = all.filter(
      (row) =>
        (!states.value || row.state === states.value) &&
        (!text || `${row.clip} ${row.subject ?? ""} ${row.why ?? ""} ${row.notes ?? ""}`.toLowerCase().includes(text)),
    );
    chosen.sort(compared);
    made = 0;
    body.replaceChildren();
    more();
    for (const head of heads) {
      const sorted = head.dataset.key === order.key;
      if (sorted) head.setAttribute("aria-sort", order.down ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    }
  }

  const search = element("input", { type: "search", placeholder: "clip, subject or reason", "aria-label": "Search" });
  search.oninput = draw;
  const states = element("select", { "aria-label": "State" }, element("option", { value: "" }, "every state"));
  states.append(...[...new Set(all.map((row) => row.state))].map((state) => element("option", {}, state)));
  states.onchange = draw;
  const heads = columns.map((column) => {
    const button = element("button", { type: "button" }, column.title);
    button.onclick = () => {
      order = { key: column.key, down: order.key === column.key ? !order.down : Boolean(column.number) };
      draw();
    };
    return element("th", { "data-key": column.key, ...(column.number && { class: "n" }) }, button);
  });
  const table = element("table", {}, element("thead", {}, element("tr", {}, ...heads)), body);
  document.getElementById("clips").append(element("div", { class: "tools" }, search, states, told), table, end);
  new IntersectionObserver((seen) => seen.some((entry) => entry.isIntersecting) && more(), {
    rootMargin: "1000px",
  }).observe(end);
  draw();
})();
