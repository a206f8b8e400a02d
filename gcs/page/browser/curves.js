// Curves over time, one panel each, above a strip with the phases that stays in sight: both are dragged to choose the time.

import { colourOf } from "./colours.js";
import { fixed } from "./scene_data.js";
import { niceStep } from "./world.js";

const PANEL = 62;
const STRIP = 36; // phases and changes of shape
const LEFT = 46;
const RIGHT = 10;
const NARROW = 700; // pixels: there the words of a curve alone have room
const EACH = 20; // vehicles with a line of their own, at most
const DOTS = 1500; // of such a line

export class Curves {
  constructor(canvas, strip, scene, onTime) {
    this.canvas = canvas;
    this.strip = strip;
    this.scene = scene;
    strip.style.height = `${STRIP}px`;
    const drag = (event) => onTime(this.timeAt(event.offsetX));
    for (const part of [canvas, strip]) {
      part.addEventListener("pointerdown", (event) => {
        part.setPointerCapture(event.pointerId);
        drag(event);
      });
      part.addEventListener("pointermove", (event) => {
        if (event.buttons) drag(event);
      });
    }
    this.update();
  }

  // Show curves that are not shown otherwise, or no longer.
  showAll(isAll) {
    this.showsAll = isAll;
    this.update();
  }

  // Read the curves again: of a flight under way they grow.
  update() {
    const isShown = (curve) => (!curve.on_demand || this.showsAll) && curve.flown.length + curve.planned.length > 0;
    this.lines = this.scene.curveLines().filter(isShown);
    this.canvas.style.height = `${this.lines.length * PANEL}px`;
    this.drawn = null;
  }

  x(t) {
    const { begin, end } = this.scene;
    return LEFT + ((t - begin) / (end - begin)) * (this.width - LEFT - RIGHT);
  }

  timeAt(x) {
    const { begin, end } = this.scene;
    const share = (x - LEFT) / (this.width - LEFT - RIGHT);
    return begin + Math.min(Math.max(share, 0), 1) * (end - begin);
  }

  // All but the line of now is drawn once, and again when size, colours or curves change.
  draw(t, style) {
    const ratio = window.devicePixelRatio;
    const key = `${this.canvas.clientWidth} ${this.canvas.clientHeight} ${ratio} ${style.text}`;
    if (this.drawn !== key) {
      this.drawn = key;
      this.width = this.canvas.clientWidth;
      this.still = [this.canvas, this.strip].map((part) => this.blank(part, ratio));
      this.drawStill(this.still[0].pen, style, this.canvas.clientHeight);
      this.drawStrip(this.still[1].pen, style);
    }
    const [pen] = [this.canvas, this.strip].map((part, n) => this.drawNow(part, this.still[n].canvas, t, style, ratio));
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "left";
    pen.textBaseline = "top";
    for (const [n, curve] of this.lines.entries()) {
      const words = this.words(curve, t);
      const room = pen.measureText(words.text).width;
      pen.fillStyle = style.back;
      pen.globalAlpha = 0.8;
      pen.fillRect(LEFT + 2, n * PANEL + 3, room + 8, 15);
      pen.globalAlpha = 1;
      pen.fillStyle = words.isBad ? style.bad : style.text;
      pen.fillText(words.text, LEFT + 6, n * PANEL + 4);
    }
  }

  // What stands still of a canvas, empty, with its pen; the canvas gets the size that it has in the window.
  blank(part, ratio) {
    part.width = part.clientWidth * ratio;
    part.height = part.clientHeight * ratio;
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [part.width, part.height];
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    return { canvas, pen };
  }

  drawNow(part, still, t, style, ratio) {
    const pen = part.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, part.width, part.height);
    pen.drawImage(still, 0, 0);
    pen.scale(ratio, ratio);
    pen.strokeStyle = style.text;
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.moveTo(this.x(t), 0);
    pen.lineTo(this.x(t), part.clientHeight);
    pen.stroke();
    return pen;
  }

  // What a curve says at a time, and whether it is beyond its limit.
  words(curve, t) {
    const value = valueAt(known(curve), t);
    const named = curve.behind(t).filter((sysid) => sysid > 0);
    const who = named.length ? ` (${named.length > 1 ? "vehicles" : "vehicle"} ${named.join(", ")})` : "";
    const told = curve.true.length ? valueAt(curve.flown, t) : NaN;
    const also = Number.isFinite(told) && this.width > NARROW ? `, reported ${fixed(told, 2)}` : "";
    const said = Number.isFinite(value) ? `${fixed(value, 2)} ${curve.unit}${who}${also}` : "–";
    const holds = curve.name !== "least height above ground" || this.scene.isAloft(t);
    const isBad = holds && curve.limit != null && (curve.at_least ? value < curve.limit : value > curve.limit);
    return { text: `${isBad ? "! " : ""}${curve.name}: ${said}`, isBad };
  }

  // When a curve is worst between take-off and landing. Null where nothing is known.
  worst(curve) {
    let found = null;
    for (const [t, value] of known(curve)) {
      if (!Number.isFinite(value) || (this.scene.phases.length && !this.scene.isAloft(t))) continue;
      if (!found || (curve.at_least ? value < found.value : value > found.value)) found = { t, value };
    }
    return found;
  }

  get separation() {
    return this.lines.find((curve) => curve.name === "least separation");
  }

  drawStill(pen, style, height) {
    pen.font = "10px system-ui, sans-serif";
    for (const [n, curve] of this.lines.entries()) this.drawPanel(pen, style, curve, n * PANEL);
    this.drawEvents(pen, style, height);
  }

  // When incidents and orders were.
  drawEvents(pen, style, height) {
    for (const event of this.scene.events) {
      if (!event.is_bad || event.t_s === null) continue;
      pen.strokeStyle = style.bad;
      pen.globalAlpha = 0.6;
      pen.setLineDash([2, 3]);
      pen.beginPath();
      pen.moveTo(this.x(event.t_s), 0);
      pen.lineTo(this.x(event.t_s), height);
      pen.stroke();
      pen.setLineDash([]);
      pen.globalAlpha = 1;
    }
  }

  drawPanel(pen, style, curve, top) {
    const bottom = top + PANEL - 6;
    const values = [...curve.flown, ...curve.planned, ...curve.true].map(([, value]) => value).filter(Number.isFinite);
    const sorted = values.sort((a, b) => a - b);
    // What counts of a distance is how small it is: landed vehicles may be far apart, beyond the panel.
    const usual = sorted[Math.floor((curve.at_least ? 0.95 : 1) * (sorted.length - 1))] ?? 1;
    const most = Math.max(1.25 * usual, 1.3 * (curve.limit ?? 0), 1e-3);
    const least = Math.min(sorted[0] ?? 0, 0);
    const y = (value) => bottom - ((value - least) / (most - least)) * (PANEL - 22);
    pen.strokeStyle = style.faint;
    pen.fillStyle = style.text;
    pen.lineWidth = 1;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const step = niceStep((most - least) / 3);
    for (let value = Math.ceil(least / step) * step; value <= most; value += step) {
      pen.beginPath();
      pen.moveTo(LEFT, y(value));
      pen.lineTo(this.width - RIGHT, y(value));
      pen.stroke();
      pen.fillText(`${Number(value.toPrecision(3))}`, LEFT - 5, y(value));
    }
    const worst = this.worst(curve);
    if (worst) {
      pen.font = "12px system-ui, sans-serif";
      pen.textBaseline = "top";
      const text = `${curve.at_least ? "least" : "most"} ${fixed(worst.value, 2)} ${curve.unit} at ${fixed(worst.t, 1)} s`;
      if (this.width > NARROW) pen.fillText(text, this.width - RIGHT, top + 4);
      pen.font = "10px system-ui, sans-serif";
      pen.textBaseline = "middle";
      pen.beginPath();
      pen.arc(this.x(worst.t), y(worst.value), 3, 0, 2 * Math.PI);
      pen.fill();
    }
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, top + 2, this.width - LEFT - RIGHT, PANEL - 6);
    pen.clip();
    this.strokeEach(pen, curve.each ?? [], y);
    this.stroke(pen, curve.planned, y, curve.flown.length || this.scene.isLive ? style.planned : style.line, 1.3);
    this.stroke(pen, curve.flown, y, style.line, 1.6);
    pen.setLineDash([5, 3]);
    this.stroke(pen, curve.true, y, style.text, 1.6);
    pen.setLineDash([]);
    pen.restore();
    if (curve.limit == null) return;
    pen.strokeStyle = style.bad;
    pen.setLineDash([6, 4]);
    pen.beginPath();
    pen.moveTo(LEFT, y(curve.limit));
    pen.lineTo(this.width - RIGHT, y(curve.limit));
    pen.stroke();
    pen.setLineDash([]);
  }

  // The line of each vehicle, faint beneath the worst of them.
  strokeEach(pen, each, y) {
    if (each.length > EACH) return;
    pen.globalAlpha = 0.55;
    for (const [row, points] of each.entries()) {
      const every = Math.ceil(points.length / DOTS);
      const some = every > 1 ? points.filter((_, n) => n % every === 0) : points;
      this.stroke(pen, some, y, colourOf(this.scene, this.scene.sysids[row]), 1);
    }
    pen.globalAlpha = 1;
  }

  stroke(pen, points, y, colour, width) {
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.beginPath();
    let isDown = false;
    for (const [t, value] of points) {
      if (!Number.isFinite(value)) {
        isDown = false;
        continue;
      }
      if (isDown) pen.lineTo(this.x(t), y(value));
      else pen.moveTo(this.x(t), y(value));
      isDown = true;
    }
    pen.stroke();
  }

  drawStrip(pen, style) {
    const { begin, end, phases, changes } = this.scene;
    pen.font = "10px system-ui, sans-serif";
    pen.textBaseline = "middle";
    pen.textAlign = "center";
    for (const [n, { name, begin_s, end_s }] of phases.entries()) {
      const [from, to] = [this.x(Math.max(begin_s, begin)), this.x(Math.min(end_s, end))];
      if (to <= from) continue;
      pen.fillStyle = n % 2 ? style.faint : style.band;
      pen.fillRect(from, 0, to - from, 16);
      pen.fillStyle = style.text;
      if (pen.measureText(name).width < to - from - 4) pen.fillText(name, (from + to) / 2, 8);
    }
    for (const { name, begin_s, end_s } of changes) {
      const [from, to] = [this.x(begin_s), this.x(end_s)];
      pen.fillStyle = style.change;
      pen.fillRect(from, 16, Math.max(to - from, 2), 4);
    }
    pen.fillStyle = style.text;
    const step = niceStep((end - begin) / Math.max(Math.floor(this.width / 110), 2));
    for (let t = Math.ceil(begin / step) * step; t <= end; t += step) {
      pen.fillText(`${Number(t.toPrecision(6))} s`, this.x(t), 28);
    }
    this.drawEvents(pen, style, 20);
  }
}

// What is known best of a curve: what was true, else what was reported, else what was planned.
function known(curve) {
  return [curve.true, curve.flown, curve.planned].find((points) => points.length) ?? [];
}

function valueAt(points, t) {
  let found = NaN;
  for (const [at, value] of points) {
    if (at > t + 1e-6) break;
    found = value;
  }
  return found;
}
