// What stands beside the scene: pre-flight checks with the word that arms, and how the flight ended, with its files.

import { post } from "./orders.js";

const PICTURE = /\.png$/;

function make(name, text = "", className = "") {
  const element = document.createElement(name);
  element.textContent = text;
  element.className = className;
  return element;
}

// A table of rows of cells, each a text or [text, class].
function tableOf(caption, heads, rows) {
  const table = make("table");
  const fill = (row, cells, name) => row.append(...cells.map((cell) => make(name, ...[cell].flat())));
  fill(table.createTHead().insertRow(), heads, "th");
  const body = table.createTBody();
  for (const cells of rows) fill(body.insertRow(), cells, "td");
  table.createCaption().textContent = caption;
  return table;
}

export class Board {
  constructor(element) {
    this.element = element;
    this.parts = {};
    element.innerHTML = `
      <form class="question" hidden>
        <label><span></span> <input autocomplete="off" autocapitalize="off" spellcheck="false" size="8"></label>
        <button>confirm</button> <output aria-live="assertive"></output>
      </form>
      <details class="checks" hidden><summary></summary><div></div></details>
      <section class="report" hidden aria-label="how the flight ended"></section>`;
    this.checks = element.querySelector(".checks");
    this.question = element.querySelector(".question");
    this.report = element.querySelector(".report");
    this.question.onsubmit = (event) => {
      event.preventDefault();
      this.confirm();
    };
  }

  // Take in what has changed; null takes a part away.
  show(changes) {
    if (!Object.keys(changes).length) return;
    Object.assign(this.parts, changes);
    const { checks, question, report } = this.parts;
    if ("checks" in changes) this.showChecks(checks);
    if ("question" in changes) this.showQuestion(question);
    if ("report" in changes) this.showReport(report);
  }

  showChecks({ title, rows }) {
    const sysids = [...new Set(rows.map((one) => one.sysid))];
    const names = [...new Set(rows.map((one) => one.name))];
    const found = new Map(rows.map((one) => [`${one.name} ${one.sysid}`, one]));
    const cell = (one) => {
      if (!one) return ["! not reported", "bad"];
      const mark = one.waived ? "WAIVED: " : one.ok ? (one.warning ? "WARNING: " : "") : "! ";
      return [mark + one.measured, one.ok || one.waived ? "" : "bad"];
    };
    const lines = names.map((name) => [
      name,
      ...sysids.map((sysid) => cell(found.get(`${name} ${sysid}`))),
      rows.find((one) => one.name === name).required,
    ]);
    const heads = ["check", ...sysids.map((sysid) => `${sysid}`), "required"];
    this.checks.querySelector("summary").textContent = `Pre-flight checks: ${title}`;
    this.checks.classList.toggle("bad", title.startsWith("NO-GO"));
    this.checks.querySelector("div").replaceChildren(
      tableOf("", heads, lines),
      ...rows.filter((one) => one.warning).map((one) => make("p", `vehicle ${one.sysid}: ${one.warning}`)),
    );
    this.checks.hidden = false;
    this.checks.open = true;
  }

  // Once it is answered, here or in the terminal, the checks make room.
  showQuestion(question) {
    const wasOpen = !this.question.hidden;
    this.question.hidden = !question;
    if (!question) {
      if (wasOpen) this.checks.open = false;
      return;
    }
    this.question.querySelector("span").textContent = question;
    this.question.querySelector("input").value = "";
    this.question.querySelector("output").textContent = "";
  }

  async confirm() {
    const { text } = await post({ word: this.question.querySelector("input").value.trim() || " " });
    this.question.querySelector("output").textContent = text;
  }

  showReport({ outcome, text, criteria, files }) {
    const when = (one) => (one.t_s === null ? "" : `${one.t_s.toFixed(1)} s`);
    const lines = criteria.map((one) => [
      one.name,
      `${one.measured}${one.vehicles ? ` (${one.vehicles})` : ""}`,
      when(one),
      one.limit,
      [(one.is_bad ? "! " : "") + one.verdict, one.is_bad ? "bad" : ""],
    ]);
    const address = (file) => `/files/${encodeURIComponent(file)}`;
    const downloads = make("p", "Files: ");
    for (const file of files) {
      const link = make("a", file);
      [link.href, link.download] = [address(file), file];
      downloads.append(link, " ");
    }
    const pictures = files.filter((file) => PICTURE.test(file)).map((file) => {
      const link = make("a");
      [link.href, link.download] = [address(file), file];
      const image = make("img");
      [image.src, image.alt, image.title] = [address(file), file, `${file}: download`];
      link.append(image);
      return link;
    });
    const table = tableOf("", ["criterion", "measured", "at", "limit", "verdict"], lines);
    criteria.forEach((one, n) => (table.tBodies[0].rows[n].title = one.definition));
    this.report.replaceChildren(
      make("h2", outcome, outcome.includes("FAILED") ? "bad" : ""),
      make("p", text),
      ...(lines.length ? [table] : []),
      ...(files.length ? [downloads] : []),
      ...pictures,
    );
    this.report.hidden = false;
  }

  get isAsking() {
    return !this.question.hidden;
  }

  get isOver() {
    return !this.report.hidden;
  }
}
