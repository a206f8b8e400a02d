// The table of vehicles: sorted by any column, red and marked with "!" where a limit is near or passed.

import { fixed } from "./scene_data.js";

const LINK_S = 2; // a vehicle that was last heard longer ago is silent
const NEAR = 1.1; // of a limit: red from there on

const number = (value, decimals) => (Number.isFinite(value) ? fixed(value, decimals) : "–");

function columns(scene) {
  const { above_ground_m: low, separation_m: apart } = scene.limits;
  const told = [
    { name: "mode", of: (one) => one.mode ?? "", text: (one) => one.mode || "–" },
    { name: "armed", of: (one) => Number(one.armed ?? 0), text: (one) => (one.armed ? "yes" : "no") },
    {
      name: scene.needed_pct ? "battery % (needs)" : "battery %",
      of: (one) => (one.battery >= 0 ? one.battery : NaN),
      text: (one) => number(one.battery >= 0 ? one.battery : NaN, 0) + (one.needed > 0 ? ` (${number(one.needed, 0)})` : ""),
      isBad: (one) => one.battery >= 0 && one.battery < NEAR * one.needed,
    },
    { name: "heard s ago", of: (one) => one.age, decimals: 1, isBad: (one) => one.age > LINK_S },
    { name: "lost %", of: (one) => 100 * one.loss, decimals: 1, isLive: true },
    { name: "error m", of: (one) => one.error, decimals: 2 },
    {
      name: "band",
      of: (one) => Number(one.inBand ?? -1),
      text: (one) => ({ true: "in", false: "out" })[one.inBand] ?? "–",
      isBad: (one) => one.inBand === false,
      isBand: true,
    },
  ];
  return [
    { name: "vehicle", of: (one) => one.sysid, text: (one) => `${one.sysid}${one.sysid === scene.leader ? "★" : ""}` },
    ...(scene.told || scene.isLive ? told.filter((column) => (!column.isLive || scene.isLive) && (!column.isBand || scene.band)) : []),
    { name: "height m", of: (one) => (one.place ? -one.place[2] : NaN), decimals: 1 },
    {
      name: "above ground m",
      of: (one) => one.above,
      decimals: 1,
      isBad: (one, isAloft) => isAloft && one.above < NEAR * low,
    },
    { name: "speed m/s", of: (one) => one.speed, decimals: 1 },
    {
      name: "nearest m",
      of: (one) => one.apart,
      text: (one) => (one.neighbour ? `${number(one.apart, 2)} (${one.neighbour})` : "–"),
      isBad: (one) => one.apart < NEAR * apart,
    },
  ];
}

export class VehicleTable {
  constructor(element, scene, onVehicle) {
    this.scene = scene;
    this.columns = columns(scene);
    this.order = { column: this.columns[0], isDown: false };
    this.table = document.createElement("table");
    this.table.innerHTML = "<caption>Vehicles</caption><thead><tr></tr></thead><tbody></tbody>";
    this.heads = this.columns.map((column) => {
      const head = document.createElement("th");
      const button = document.createElement("button");
      button.textContent = column.name;
      button.onclick = () => this.sort(column);
      head.append(button);
      this.table.querySelector("tr").append(head);
      return head;
    });
    this.rows = new Map(
      scene.sysids.map((sysid) => {
        const row = document.createElement("tr");
        const cells = this.columns.map(() => row.appendChild(document.createElement("td")));
        row.onclick = () => onVehicle(sysid);
        if (scene.isLive) cells[0] = this.ticking(cells[0], sysid);
        return [sysid, { row, cells }];
      }),
    );
    this.body = this.table.querySelector("tbody");
    element.append(this.table);
    this.sort(this.columns[0], false);
  }

  // Put a box into a cell that an order goes to this vehicle, none ticked: to all; return what has its text.
  ticking(cell, sysid) {
    const box = document.createElement("input");
    box.type = "checkbox";
    box.value = sysid;
    box.setAttribute("aria-label", `order to vehicle ${sysid}`);
    box.onclick = (event) => event.stopPropagation();
    box.onchange = () => this.onTick();
    const text = document.createElement("span");
    cell.append(box, text);
    return text;
  }

  ticked() {
    return [...this.body.querySelectorAll("input:checked")].map((box) => Number(box.value)).sort((a, b) => a - b);
  }

  sort(column, isDown = this.order.column === column && !this.order.isDown) {
    this.order = { column, isDown };
    for (const [n, head] of this.heads.entries()) {
      const way = isDown ? "descending" : "ascending";
      head.setAttribute("aria-sort", this.columns[n] === column ? way : "none");
    }
    if (this.shown) this.show(...this.shown);
  }

  // Write the cells that changed, and order the rows.
  show(vehicles, isAloft) {
    this.shown = [vehicles, isAloft];
    const sign = this.order.isDown ? -1 : 1;
    const key = (one) => this.order.column.of(one);
    const isUnknown = (value) => value === undefined || Number.isNaN(value);
    const compare = (a, b) => {
      const [first, second] = [key(a), key(b)];
      if (isUnknown(first) || isUnknown(second)) return isUnknown(first) - isUnknown(second) || a.sysid - b.sysid;
      return first < second ? -sign : first > second ? sign : a.sysid - b.sysid;
    };
    const sorted = [...vehicles].sort(compare);
    for (const [n, one] of sorted.entries()) {
      const { row, cells } = this.rows.get(one.sysid);
      for (const [at, column] of this.columns.entries()) {
        const isBad = column.isBad?.(one, isAloft) ?? false;
        const text = (isBad ? "! " : "") + (column.text ? column.text(one) : number(column.of(one), column.decimals));
        if (cells[at].textContent !== text) cells[at].textContent = text;
        if (cells[at].className !== (isBad ? "bad" : "")) cells[at].className = isBad ? "bad" : "";
      }
      if (this.body.children[n] !== row) this.body.insertBefore(row, this.body.children[n] ?? null);
    }
  }
}
