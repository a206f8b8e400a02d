// The page: scene in space, curves, table and log at one time, which is played, dragged, or now.

import { Board } from "./board.js";
import { Curves } from "./curves.js";
import { EventLog } from "./event_log.js";
import { Orders } from "./orders.js";
import { PlanOrders } from "./plan_orders.js";
import { SceneData } from "./scene_data.js";
import { VehicleTable } from "./vehicle_table.js";
import { World } from "./world.js";

const RATES = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50];
const FRAME_MS = 30; // between frames
const TABLE_MS = 200; // between redraws of the table
const NEWS_MS = 1000; // between redraws of what a flight under way adds to: curves, tracks, log
const KEYS = "space: play, ← →: 1 s (with shift 10 s), [ ]: slower, faster, home, end, n: now, a: all, c: chase, u: above, s: side, w: nearest two";
const LOOKS = {
  light: { text: "#15191e", back: "#ffffff", faint: "#dde3ea", band: "#c3cedb" },
  dark: { text: "#eef2f6", back: "#1d2229", faint: "#39424d", band: "#4a5666" },
};
const SAME = { bad: "#d03020", line: "#0a84d0", planned: "#8a8f96", change: "#cc79a7" };

const PAGE = `
  <header>
    <h1></h1><output class="now" aria-live="off"></output>
    <span class="views" role="group" aria-label="view">
      <button data-view="all">all</button><button data-view="chase">chase</button>
      <button data-view="above">from above</button><button data-view="side">side</button><select aria-label="one vehicle"><option value="">vehicle …</option></select>
    </span>
    <button class="dark" title="light or dark">◐</button>
  </header>
  <p class="notes"></p>
  <main>
    <section class="space" aria-label="scene in space"></section>
    <aside><div class="board"></div><div class="command" hidden><div class="ordered"></div><div class="changed"></div></div><div class="fleet"></div><div class="events"><h2>Events</h2></div></aside>
  </main>
  <footer>
    <div class="player">
      <button class="play" title="${KEYS}">▶</button>
      <select class="rate" aria-label="speed"></select>
      <input class="time" type="range" step="any" aria-label="time">
      <button class="live" hidden>now</button>
      <button class="nearest" title="go to when two vehicles were nearest between take-off and landing (w)">nearest two</button>
      <output class="found" aria-live="polite"></output>
      <span class="legend" aria-label="lines of the curves"></span>
      <label class="more" hidden><input type="checkbox"> U1–U4</label>
    </div>
    <div class="curves"><canvas></canvas><canvas class="strip"></canvas></div>
  </footer>`;

export function openPage(element, onDrawn) {
  const page = new Page(element, onDrawn);
  window.skein = page; // tests read the scene back from it
  return page;
}

class Page {
  constructor(element, onDrawn) {
    this.element = element;
    this.onDrawn = onDrawn;
    this.isPlaying = false;
    this.isStale = true; // something has changed since the last frame
    this.rate = 1;
    const style = document.createElement("link");
    style.rel = "stylesheet";
    style.href = new URL("page.css", import.meta.url).href;
    style.onload = () => this.load();
    document.head.append(style);
  }

  find(selector) {
    return this.element.querySelector(selector);
  }

  // Read the whole scene; of another plan, or of the flight that is over, in place of the one before.
  async load(kept) {
    const answer = await fetch("/scene");
    if (!answer.ok) throw new Error(`the scene was refused: ${answer.status}`);
    const whole = await answer.json();
    this.close();
    this.sceneNumber = whole.board.scene;
    this.scene = new SceneData(whole);
    const { scene } = this;
    this.element.innerHTML = PAGE;
    this.find("h1").textContent = this.find("h1").title = scene.name;
    this.find(".notes").textContent = scene.notes.join(" ");
    this.t = scene.isLive ? this.newest() : Math.min(Math.max(kept?.t ?? scene.begin, scene.begin), scene.end);
    this.isNow = scene.isLive && (kept?.isNow ?? true);
    if (!this.isNow && kept) this.t = kept.t;
    this.find(".live").hidden = !scene.isLive;
    this.world = new World(this.find(".space"), scene, () => (this.isStale = true));
    this.curves = new Curves(this.find(".curves canvas"), this.find(".strip"), scene, (t) => this.seek(t));
    this.makeTable();
    this.orders = this.changes = null;
    if (scene.isLive) {
      this.orders = new Orders(this.find(".ordered"), () => this.table.ticked());
      this.changes = new PlanOrders(this.find(".changed"), scene, this.world);
      this.changes.onView = () => this.look("above");
    }
    this.board = new Board(this.find(".board"));
    this.showBoard(whole.board);
    this.log = new EventLog(this.find(".events"), scene, (t) => this.seek(t));
    this.find(".events").hidden = scene.kind === "plan" && !scene.events.length; // none will come
    this.listen();
    this.setDark(kept?.isDark ?? window.matchMedia("(prefers-color-scheme: dark)").matches);
    this.world.drawTracks();
    this.look(kept?.view ?? (scene.isLive ? "chase" : "all"));
    if (kept?.pose) this.world.pose = kept.pose;
    this.frame = requestAnimationFrame((ms) => this.draw(ms));
    this.onDrawn(scene.events.length);
    this.resizing = new ResizeObserver(() => (this.isStale = true));
    this.resizing.observe(this.element);
  }

  makeTable() {
    this.find(".fleet").replaceChildren();
    this.table = new VehicleTable(this.find(".fleet"), this.scene, (sysid) => this.look(`${sysid}`));
    this.table.onTick = () => this.orders.name();
    this.isStale = true;
  }

  listen() {
    for (const button of this.element.querySelectorAll("[data-view]")) {
      button.onclick = () => this.look(button.dataset.view);
    }
    const choice = this.find(".views select");
    choice.append(...this.scene.sysids.map((sysid) => new Option(`vehicle ${sysid}`, sysid)));
    choice.onchange = () => choice.value && this.look(choice.value);
    const rate = this.find(".rate");
    rate.append(...RATES.map((value) => new Option(`${value} ×`, value, false, value === 1)));
    rate.onchange = () => (this.rate = Number(rate.value));
    this.find(".play").onclick = () => this.play(!this.isPlaying);
    this.find(".live").onclick = () => this.follow();
    const more = this.find(".more");
    more.hidden = !this.scene.curves.some((curve) => curve.on_demand);
    more.firstChild.onchange = ({ target }) => {
      this.curves.showAll(target.checked);
      this.isStale = true;
    };
    this.nameLines();
    this.find(".nearest").hidden = this.scene.sysids.length < 2;
    this.find(".nearest").onclick = () => this.nearest();
    this.find(".dark").onclick = () => this.setDark(!this.isDark);
    const time = this.find(".time");
    [time.min, time.max] = [this.scene.begin, this.scene.end];
    time.oninput = () => this.seek(Number(time.value));
    this.onKey = (event) => this.key(event);
    document.addEventListener("keydown", this.onKey);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || this.orders?.dialog.open) return;
    const isTyped = event.target.matches?.("select, input:not([type=range])");
    const isPressed = event.key === " " && event.target.matches?.("button");
    if (isTyped || isPressed) return;
    const step = event.shiftKey ? 10 : 1;
    const acts = {
      " ": () => this.play(!this.isPlaying),
      ArrowLeft: () => this.seek(this.t - step),
      ArrowRight: () => this.seek(this.t + step),
      Home: () => this.seek(this.scene.begin),
      End: () => this.seek(this.scene.end),
      "[": () => this.change(-1),
      "]": () => this.change(1),
      n: () => this.follow(),
      a: () => this.look("all"),
      c: () => this.look("chase"),
      u: () => this.look("above"),
      s: () => this.look("side"),
      w: () => this.nearest(),
    };
    const act = acts[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  change(steps) {
    const rate = this.find(".rate");
    rate.selectedIndex = Math.min(Math.max(rate.selectedIndex + steps, 0), RATES.length - 1);
    this.rate = Number(rate.value);
  }

  look(view) {
    this.world.setView(view);
    this.isStale = true;
    for (const button of this.element.querySelectorAll("[data-view]")) {
      button.setAttribute("aria-pressed", button.dataset.view === view);
    }
    const choice = this.find(".views select");
    choice.value = this.scene.sysids.includes(Number(view)) ? view : "";
  }

  play(isPlaying) {
    if (isPlaying && this.t >= this.scene.end) this.t = this.scene.begin;
    this.isPlaying = isPlaying;
    this.isNow = false;
    this.find(".play").textContent = isPlaying ? "❚❚" : "▶";
  }

  follow() {
    this.isNow = this.scene.isLive;
    this.isStale = true;
  }

  seek(t) {
    this.isNow = false;
    this.isStale = true;
    this.t = Math.min(Math.max(t, this.scene.begin), this.scene.end);
  }

  // Go to when two vehicles were nearest, say where, and look at one of them: the other stands beside it.
  nearest() {
    const { separation } = this.curves;
    const worst = separation && this.curves.worst(separation);
    if (!worst) return;
    this.play(false);
    this.seek(worst.t);
    const pair = separation.behind(worst.t);
    const place = this.scene.vehicles(worst.t, false).find((one) => one.sysid === pair[0])?.place;
    const where = place ? `, ${place[0].toFixed(0)} m north, ${place[1].toFixed(0)} m east, ${(-place[2]).toFixed(0)} m high` : "";
    this.find(".found").textContent = `vehicles ${pair.join(", ")}: ${worst.value.toFixed(2)} m at ${worst.t.toFixed(1)} s${where}`;
    if (pair[0] > 0) this.look(`${pair[0]}`);
  }

  // What the lines of the curves are, of those that there are.
  nameLines() {
    const has = (name) => this.scene.curves.some((curve) => curve[name]);
    const names = { planned: "planned", flown: "reported", true: "true" };
    const kinds = Object.keys(names).filter((name) => has(name) || (name === "flown" && this.scene.isLive));
    const lines = (kinds.length > 1 ? kinds : []).map((kind) => {
      const line = document.createElement("span");
      [line.className, line.textContent] = [kind, names[kind]];
      return line;
    });
    if (this.scene.curves.some((curve) => curve.limit != null)) {
      const limit = document.createElement("span");
      [limit.className, limit.textContent] = ["limit", "limit"];
      lines.push(limit);
    }
    this.find(".legend").replaceChildren(...lines);
  }

  newest() {
    const t = this.scene.newest?.t_s;
    return Number.isFinite(t) ? t : this.scene.begin;
  }

  setDark(isDark) {
    this.isDark = isDark;
    this.element.classList.toggle("is-dark", isDark);
    this.style = { ...SAME, ...LOOKS[isDark ? "dark" : "light"] };
    this.world.setDark(isDark);
    this.isStale = true;
  }

  // What the server sends of a flight under way.
  receive({ picture, events, board }) {
    if (!this.scene) return;
    this.showBoard(board);
    this.scene.events.push(...events);
    if (picture) this.scene.add(picture);
    this.hasNews = this.isBehind = true;
    if (document.hidden) this.onDrawn(this.scene.events.length); // a hidden page draws no frame
  }

  // Before the word that arms nothing flies, and a flight that is over takes no orders.
  showBoard(changes) {
    this.board.show(changes);
    if (changes.outcome) this.changes?.say(changes.outcome);
    if (changes.scene && changes.scene !== this.sceneNumber) {
      this.sceneNumber = changes.scene;
      this.load({ t: this.t, isNow: this.isNow, isDark: this.isDark, view: this.world.view, pose: this.world.pose });
    }
    if (changes.tiles) this.world.layMap(changes.tiles);
    if (changes.band) {
      this.scene.take("band", changes.band);
      this.makeTable();
    }
    this.find(".command").hidden = !this.orders || this.board.isOver || this.board.isAsking;
  }

  // Draw if anything has changed: a browser that draws in software takes its time from a flight on the same machine.
  draw(ms) {
    this.frame = requestAnimationFrame((next) => this.draw(next));
    if (ms - this.lastMs < FRAME_MS) return;
    const past = Math.min((ms - (this.lastMs ?? ms)) / 1000, 0.25);
    this.lastMs = ms;
    if (this.isNow) this.t = this.newest();
    else if (this.isPlaying) {
      this.t = Math.min(this.t + past * this.rate, this.scene.end);
      if (this.t >= this.scene.end) this.play(false);
    }
    const isTableDue = this.isTableBehind && !(ms - this.tableMs < TABLE_MS);
    const isNewsDue = this.isBehind && !(ms - this.newsMs < NEWS_MS);
    if (!this.isStale && !this.isPlaying && !this.hasNews && !isTableDue && !isNewsDue) return;
    this.isStale = false;
    this.drawAll(ms);
  }

  drawAll(ms) {
    const { scene } = this;
    this.isTableBehind = true;
    const vehicles = scene.vehicles(this.t, this.isNow);
    if (this.isBehind && !(ms - this.newsMs < NEWS_MS)) {
      this.newsMs = ms;
      this.isBehind = false;
      this.curves.update();
      this.world.drawTracks();
      this.log.update();
    }
    this.world.show(this.t, vehicles);
    this.curves.draw(this.t, this.style);
    if (!(ms - this.tableMs < TABLE_MS)) {
      this.tableMs = ms;
      this.isTableBehind = false;
      this.table.show(vehicles, scene.isAloft(this.t));
      this.log.show(this.isNow ? Infinity : this.t);
      this.find(".now").textContent = this.words();
      this.find(".time").value = this.t;
      this.find(".live").setAttribute("aria-pressed", this.isNow);
    }
    if (this.hasNews) {
      this.hasNews = false;
      this.onDrawn(scene.events.length);
    }
  }

  // The time and what is flown then.
  words() {
    const { scene, t } = this;
    if (!scene.isLive) return `t = ${t.toFixed(1)} s  ${scene.phase(t)}`;
    const picture = this.isNow ? scene.newest : scene.pictureAt(t);
    const when = this.isNow && !Number.isFinite(picture?.t_s) ? "before T0" : `t = ${t.toFixed(1)} s`;
    return `${when}  ${picture?.step ?? ""}`;
  }

  close() {
    cancelAnimationFrame(this.frame);
    this.resizing?.disconnect();
    document.removeEventListener("keydown", this.onKey);
    this.world?.close();
  }
}
