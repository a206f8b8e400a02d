// Orders that change the plan: the flight plans first, the page shows the way and what it costs, you accept it.

import { post } from "./orders.js";
import { unpacked } from "./scene_data.js";
import { ZoneDrawing } from "./zone_drawing.js";

const HINTS = {
  avoid: "north,east,radius in m",
  go: "north,east,height in m",
  slower: "0.7",
  hold: "",
  resume: "",
  scale: "0.6",
  shape: "name of a shape",
  home: "",
};

export class PlanOrders {
  constructor(element, scene, world) {
    element.innerHTML = `
      <form class="orders">
        <label>plan: <select>${Object.keys(HINTS).map((name) => `<option>${name}</option>`).join("")}</select></label>
        <input list="skein-shapes" aria-label="of what" autocomplete="off" size="14">
        <datalist id="skein-shapes"></datalist>
        <button type="button" class="draw">draw it</button>
        <button class="propose">propose …</button>
      </form>
      <div class="proposal" role="group" aria-label="proposed plan" hidden>
        <p></p>
        <button class="accept">fly this plan</button> <button class="drop">cancel</button>
      </div>
      <output aria-live="polite"></output>`;
    this.element = element;
    this.shapes = scene.shapes;
    this.drawing = new ZoneDrawing(world);
    this.result = element.querySelector("output");
    this.proposal = element.querySelector(".proposal");
    this.kind = element.querySelector("select");
    this.of = element.querySelector("form input");
    this.kind.onchange = () => this.choose();
    element.querySelector("form").onsubmit = (event) => {
      event.preventDefault();
      this.propose();
    };
    element.querySelector(".draw").onclick = () => this.draw();
    element.querySelector(".drop").onclick = () => this.drop();
    element.querySelector(".accept").onclick = () => this.accept();
    this.choose();
  }

  choose() {
    const kind = this.kind.value;
    this.of.value = "";
    this.of.placeholder = HINTS[kind];
    this.of.hidden = !HINTS[kind];
    this.element.querySelector(".draw").hidden = kind !== "avoid";
    const names = kind === "shape" ? this.shapes : [];
    this.element.querySelector("datalist").replaceChildren(...names.map((name) => new Option(name)));
  }

  // A zone is drawn on the map, and planned round at once; nothing is flown before you accept it.
  draw() {
    this.drop();
    this.onView();
    this.result.textContent = "press at the centre of the zone and drag to its edge";
    this.drawing.begin((drawn) => {
      this.of.value = drawn.map((metres) => metres.toFixed(1)).join(",");
      this.propose();
    });
  }

  async propose() {
    this.drop();
    if (this.kind.value === "avoid") {
      const zone = this.of.value.split(",").map(Number);
      if (zone.length === 3 && zone.every(Number.isFinite)) this.drawing.showZone(...zone);
    }
    this.result.textContent = "planning …";
    const asked = `${this.kind.value} ${this.of.value.trim()}`.trim();
    const { may, text, number, way } = await post({ change: asked });
    this.result.textContent = may ? "" : text;
    if (!may) return;
    this.said = number;
    if (way) this.drawing.showWay(unpacked(way));
    this.proposal.querySelector("p").textContent = `${text}. It is planned anew from the moment that you accept it.`;
    this.proposal.hidden = false;
    this.proposal.querySelector(".drop").focus();
  }

  drop() {
    this.proposal.hidden = true;
    this.result.textContent = "";
    this.drawing.clear();
  }

  async accept() {
    this.proposal.hidden = true;
    const { text } = await post({ confirms: this.said });
    this.result.textContent = text;
  }

  // Take in what came of an order.
  say(text) {
    this.result.textContent = text;
    this.drawing.clear();
  }
}
