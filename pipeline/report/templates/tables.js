"use strict";
// Tables that sort by a heading and filter their rows; without JavaScript everything remains readable.
(() => {
  for (const words of document.querySelectorAll("[data-without-scripts]")) words.remove();
  for (const control of document.querySelectorAll("[data-with-scripts]")) control.hidden = false;
  for (const box of document.querySelectorAll("[data-more]")) {
    const choose = () => document.getElementById(box.dataset.more).classList.toggle("brief", !box.checked);
    box.addEventListener("change", choose);
    choose();
  }
  const value = (row, column) => row.cells[column].dataset.value ?? row.cells[column].textContent.trim();
  const nothing = (text) => text === "" || text === "–";
  const number = (text) => (nothing(text) ? NaN : Number(text));
  const compare = (a, b) => {
    const [x, y] = [number(a), number(b)];
    return Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, undefined, { numeric: true }) : x - y;
  };
  const order = (down) => (a, b) => {
    if (nothing(a) || nothing(b)) return nothing(a) - nothing(b); // rows without a value stay at the end
    return down ? compare(b, a) : compare(a, b);
  };

  function sort(table, heading) {
    const down = heading.getAttribute("aria-sort") === "ascending";
    for (const other of heading.parentElement.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    const by = order(down);
    const rows = [...table.tBodies[0].rows];
    rows.sort((a, b) => by(value(a, heading.cellIndex), value(b, heading.cellIndex)));
    table.tBodies[0].append(...rows);
  }

  // A word matches anywhere in a row; `column > 10` compares a column, named by the start of its heading or of its key.
  const plain = (text) => text.toLowerCase().replace(/[^\p{L}\p{N}]/gu, "");
  const COMPARE = { "<": (a, b) => a < b, ">": (a, b) => a > b, "<=": (a, b) => a <= b, ">=": (a, b) => a >= b, "=": (a, b) => a === b };
  const CONDITION = /([^<>=]*)(<=|>=|<|>|=)\s*(-?[\d.]+(?:e-?\d+)?)/g;
  const words = (text) => text.split(/[\s,]+/).filter((word) => word && word !== "and");
  const has = (word) => (row) => row.textContent.toLowerCase().includes(word);

  function column_of(table, name) {
    const named = (heading) => [heading.dataset.name ?? "", heading.textContent, heading.textContent.split(".").pop()]
      .some((text) => plain(text).startsWith(plain(name)));
    return plain(name) ? [...table.tHead.rows[0].cells].findIndex(named) : -1;
  }

  // The last words before a sign name its column, as many as begin a heading; those before them are words to find.
  function tests_of(table, text) {
    const found = [];
    for (const [, before, sign, limit] of text.matchAll(CONDITION)) {
      const own = words(before);
      const first = own.findIndex((_, i) => column_of(table, own.slice(i).join(" ")) >= 0);
      if (first < 0) return { unknown: own.join(" ") || sign };
      const column = column_of(table, own.slice(first).join(" "));
      found.push(...own.slice(0, first).map(has), (row) => COMPARE[sign](number(value(row, column)), Number(limit)));
    }
    return { tests: [...found, ...words(text.replace(CONDITION, "")).map(has)] };
  }

  function filter(field) {
    const table = document.getElementById(field.dataset.filter);
    const { tests = [() => false], unknown } = tests_of(table, field.value.toLowerCase());
    const rows = [...table.tBodies[0].rows];
    for (const row of rows) row.hidden = !tests.every((holds) => holds(row));
    const shown = rows.filter((row) => !row.hidden).length;
    document.querySelector(`[data-shown="${field.dataset.filter}"]`).textContent =
      unknown ? `no column begins with “${unknown}” (example: confinement > 10, rows = 2)`
        : `${shown} of ${rows.length} shown${shown ? "" : ": no row has all of it (example: confinement > 10, rows = 2)"}`;
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    table.tHead.addEventListener("click", (event) => {
      const button = event.target.closest("button");
      if (button) sort(table, button.closest("th"));
    });
  }
  for (const field of document.querySelectorAll("input[data-filter]")) field.addEventListener("input", () => filter(field));

  const open_target = () => {
    const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const fold = target && target.closest("details");
    if (fold) { fold.open = true; target.scrollIntoView(); }
  };
  addEventListener("hashchange", open_target);
  addEventListener("beforeprint", () => {
    for (const fold of document.querySelectorAll("details")) fold.open = true;
    for (const image of document.images) image.loading = "eager";
  });
  open_target();
})();
