// The area of a survey with its holes, and what of it the vehicles have seen, cell by cell as it grows.
import { THREE } from "nicegui-scene";

const CELLS = 130; // along the longer side
const GAP_S = 2; // without a place: what is seen in it is not known

export class Survey {
  constructor(world, label) {
    this.world = world;
    this.scene = world.scene;
    this.label = label;
    this.survey = this.scene.survey;
    this.rings = this.survey.rings_m.map(({ data }) => {
      const ring = [];
      for (let n = 0; n < data.length; n += 2) ring.push([data[n], data[n + 1]]);
      return ring;
    });
    this.drawRings();
    this.divide();
    this.done = this.scene.sysids.map(() => 1); // points of each track that are taken in
  }

  above(north, east, rise) {
    const { world } = this;
    return world.at([north, east, -(world.heightAt(north, east) + rise)]);
  }

  drawRings() {
    const look = new THREE.LineBasicMaterial({ color: "#a000a0", depthTest: false });
    for (const ring of this.rings) {
      const shape = new THREE.BufferGeometry().setFromPoints(ring.map(([north, east]) => this.above(north, east, 0.2)));
      const line = new THREE.Line(shape, look);
      line.renderOrder = 1;
      this.world.space.add(line);
    }
  }

  // The cells of the area, and when each is seen.
  divide() {
    const [north, east] = [0, 1].map((axis) => this.rings[0].map((corner) => corner[axis]));
    this.low = [Math.min(...north), Math.min(...east)];
    const side = Math.max(Math.max(...north) - this.low[0], Math.max(...east) - this.low[1]);
    this.cell = side / CELLS;
    this.columns = CELLS;
    this.of = new Map(); // number of a cell's place: its row in `cells`
    this.cells = [];
    const places = [];
    for (let i = 0; i < CELLS; i++) {
      for (let j = 0; j < CELLS; j++) {
        const [n, e] = [this.low[0] + (i + 0.5) * this.cell, this.low[1] + (j + 0.5) * this.cell];
        if (!isInside(this.rings[0], n, e) || this.rings.slice(1).some((hole) => isInside(hole, n, e))) continue;
        this.of.set(i * CELLS + j, this.cells.length);
        this.cells.push([n, e]);
        const half = this.cell / 2;
        for (const [a, b] of [[-1, -1], [-1, 1], [1, 1], [1, -1]]) {
          places.push(...this.above(n + a * half, e + b * half, 0.1).toArray());
        }
      }
    }
    this.seen = new Float64Array(this.cells.length).fill(Infinity);
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
    const look = { color: "#2ca02c", transparent: true, opacity: 0.35, side: THREE.DoubleSide, depthWrite: false };
    this.mesh = new THREE.Mesh(shape, new THREE.MeshBasicMaterial(look));
    this.mesh.material.polygonOffset = true;
    this.mesh.material.polygonOffsetFactor = this.mesh.material.polygonOffsetUnits = -2;
    this.mesh.frustumCulled = false;
    this.world.space.add(this.mesh);
  }

  // Take in what came to the tracks since.
  update() {
    const { scene } = this;
    const motion = scene.flown ?? scene.planned;
    for (const row of scene.sysids.keys()) {
      const track = scene.isLive || scene.flown ? scene.flownTrack(row) : scene.track(motion, row);
      const gap = Math.max(GAP_S, scene.isLive ? 0 : 1.5 * (scene.times[1] - scene.times[0]));
      for (let n = Math.max(this.done[row], 1); n < track.length; n++) {
        const [[from, first], [to, second]] = [track[n - 1], track[n]];
        if (first && second && from >= 0 && to <= this.survey.until_s && to - from <= gap) this.sweep(to, first, second);
      }
      this.done[row] = scene.isLive ? track.length - 1 : track.length; // the last picture of a flight is replaced
    }
    this.times = [...this.seen.keys()].sort((a, b) => this.seen[a] - this.seen[b]);
    const faces = this.times.flatMap((n) => [4 * n, 4 * n + 1, 4 * n + 2, 4 * n, 4 * n + 2, 4 * n + 3]);
    this.mesh.geometry.setIndex(faces);
  }

  // Note what a vehicle has seen at a time on the way between two places.
  sweep(t, first, second) {
    const { swath_m: swath, seen_from_m: from } = this.survey;
    const heights = [first, second].map(([north, east, down]) => -down - this.world.heightAt(north, east));
    const half = (swath / 2) * (from === null ? 1 : Math.max(Math.min(...heights), 0) / from);
    const [low, high] = [Math.min, Math.max].map((pick, n) =>
      [0, 1].map((axis) => Math.floor((pick(first[axis], second[axis]) + (n ? half : -half) - this.low[axis]) / this.cell)),
    );
    const way = [second[0] - first[0], second[1] - first[1]];
    const squared = way[0] ** 2 + way[1] ** 2;
    for (let i = Math.max(low[0], 0); i <= Math.min(high[0], CELLS - 1); i++) {
      for (let j = Math.max(low[1], 0); j <= Math.min(high[1], CELLS - 1); j++) {
        const n = this.of.get(i * CELLS + j);
        if (n === undefined || this.seen[n] <= t) continue;
        const off = [this.cells[n][0] - first[0], this.cells[n][1] - first[1]];
        const share = squared ? Math.min(Math.max((off[0] * way[0] + off[1] * way[1]) / squared, 0), 1) : 0;
        if (Math.hypot(off[0] - share * way[0], off[1] - share * way[1]) <= half) this.seen[n] = t;
      }
    }
  }

  // The share of the area that is seen until a time.
  share(t) {
    let [low, high] = [0, this.times.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.seen[this.times[middle]] <= t) low = middle + 1;
      else high = middle;
    }
    return low / this.cells.length;
  }

  show(t) {
    const share = this.share(t);
    this.mesh.geometry.setDrawRange(0, 6 * Math.round(share * this.cells.length));
    const text = `${(100 * share).toFixed(0)} % of the area seen`;
    if (this.label.textContent !== text) this.label.textContent = text;
  }
}

function isInside(ring, north, east) {
  let inside = false;
  for (let n = 0; n < ring.length - 1; n++) {
    const [[a, b], [c, d]] = [ring[n], ring[n + 1]];
    if (b > east !== d > east && north < a + ((east - b) / (d - b)) * (c - a)) inside = !inside;
  }
  return inside;
}
