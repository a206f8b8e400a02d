// The scene in space: east is x, north is y, up is z, all less the middle of the scene, so that numbers stay small.
import { OrbitControls, THREE } from "nicegui-scene";

import { Band } from "./band.js";
import { colourOf } from "./colours.js";
import { layMap } from "./map_tiles.js";
import { Survey } from "./survey.js";

const MARKER_PX = 11; // half the length of a marker
const LABELS = 60; // vehicles with a number beside them, at most
const LABEL_PX = 17; // of a number; labels that would cover each other are joined
const NAMED = 6; // numbers in one label, at most
const FIELD_DEG = 45;
const LIGHTS = { true: [0.7, 1.1], false: [1.6, 2.2] }; // all around and from the sun; in the dark less
const HIGH = 0.25; // of the longer side of the ground: how high zones are, at least
const BANDS = 10;
const GRID = 12; // lines over the ground, each way

export class World {
  constructor(element, scene, onChange) {
    this.scene = scene;
    this.view = "all";
    this.space = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(FIELD_DEG, 1, 0.1, 1000);
    this.camera.up.set(0, 0, 1);
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(window.devicePixelRatio);
    this.labels = document.createElement("div");
    this.labels.className = "labels";
    this.scale = document.createElement("div");
    this.scale.className = "scale";
    this.remarks = ["seen", "owner"].map((name) => {
      const remark = document.createElement("div");
      remark.className = `remark ${name}`;
      return remark;
    });
    element.append(this.renderer.domElement, this.labels, this.scale, ...this.remarks);
    this.onChange = onChange;
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 0.495 * Math.PI;
    this.controls.addEventListener("start", () => (this.isMoved = true));
    this.controls.addEventListener("change", onChange);
    this.lights = [new THREE.AmbientLight(0xffffff), new THREE.DirectionalLight(0xffffff)];
    this.lights[1].position.set(-1, 1, 1.2);
    this.space.add(...this.lights);
    this.measure();
    this.drawGround();
    this.drawZones();
    this.drawPlanned();
    this.drawRally();
    this.drawPoints();
    this.survey = scene.survey ? new Survey(this, this.remarks[0]) : null;
    this.tracks = scene.sysids.map((sysid) => this.line(colourOf(scene, sysid), 1));
    this.errors = this.line("#d55e00", 0.9);
    this.drops = this.line("#808080", 0.5);
    this.tails = this.line("#444444", 1);
    this.drawMarkers();
    this.resizing = new ResizeObserver(() => {
      this.resize(element);
      onChange();
    });
    this.resizing.observe(element);
    this.resize(element);
    this.setView("all");
  }

  // The middle and the size of all that is shown.
  measure() {
    const low = [Infinity, Infinity, Infinity];
    const high = [-Infinity, -Infinity, -Infinity];
    const take = ([x, y, z]) =>
      [x, y, z].forEach((value, axis) => {
        if (value < low[axis]) low[axis] = value;
        if (value > high[axis]) high[axis] = value;
      });
    for (const motion of [this.scene.planned, this.scene.flown]) {
      const data = motion?.places_ned_m.data ?? [];
      for (let n = 0; n < data.length; n += 3) take([data[n + 1], data[n], -data[n + 2]]);
    }
    const { ground } = this.scene;
    this.reach = Math.max(high[0] - low[0], high[1] - low[1], high[2] - low[2], 5);
    if (ground) {
      const [north, east] = [ground.north_m.data, ground.east_m.data];
      const heights = ground.height_m.data;
      const least = heights.reduce((a, b) => Math.min(a, b), Infinity);
      const most = heights.reduce((a, b) => Math.max(a, b), -Infinity);
      for (const z of [least, most]) {
        take([east[0], north[0], z]);
        take([east[east.length - 1], north[north.length - 1], z]);
      }
    }
    this.low = low;
    this.high = high;
    this.middle = low.map((value, axis) => (value + high[axis]) / 2);
    this.size = Math.max(high[0] - low[0], high[1] - low[1], 5);
    this.camera.near = Math.max(this.size / 20000, 0.05);
    this.camera.far = 20 * this.size; // a fixed one leaves large scenes blank
  }

  // A place in space; the argument is north, east, down.
  at([north, east, down]) {
    return new THREE.Vector3(east - this.middle[0], north - this.middle[1], -down - this.middle[2]);
  }

  drawGround() {
    const { ground } = this.scene;
    if (!ground) {
      const side = 1.2 * this.size;
      const grid = new THREE.GridHelper(side, 20, 0x888888, 0xaaaaaa);
      grid.rotation.x = Math.PI / 2;
      grid.position.z = this.low[2] - this.middle[2];
      this.space.add(grid);
      return;
    }
    const [north, east, height] = [ground.north_m.data, ground.east_m.data, ground.height_m.data];
    const [rows, columns] = [north.length, east.length];
    const [low, high] = height.reduce(([a, b], c) => [Math.min(a, c), Math.max(b, c)], [Infinity, -Infinity]);
    const step = niceStep((high - low) / BANDS);
    const places = new Float32Array(3 * rows * columns);
    const colours = new Float32Array(3 * rows * columns);
    const colour = new THREE.Color();
    for (let n = 0; n < rows * columns; n++) {
      const [i, j] = [Math.floor(n / columns), n % columns];
      places.set([east[j] - this.middle[0], north[i] - this.middle[1], height[n] - this.middle[2]], 3 * n);
      const share = high - low > 0.1 ? (height[n] - low) / (high - low) : 0;
      const band = high - low > 0.1 ? Math.floor(height[n] / step) % 2 : 0;
      colour.setHSL(0.11 - 0.03 * share, 0.3, 0.74 - 0.32 * share - 0.035 * Math.abs(band));
      colours.set([colour.r, colour.g, colour.b], 3 * n);
    }
    const faces = [];
    for (let i = 0; i < rows - 1; i++) {
      for (let j = 0; j < columns - 1; j++) {
        const n = i * columns + j;
        faces.push(n, n + 1, n + columns, n + 1, n + columns + 1, n + columns);
      }
    }
    const shape = new THREE.BufferGeometry();
    shape.setAttribute("position", new THREE.BufferAttribute(places, 3));
    shape.setAttribute("color", new THREE.BufferAttribute(colours, 3));
    shape.setIndex(faces);
    shape.computeVertexNormals();
    const look = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
    look.polygonOffset = true;
    look.polygonOffsetFactor = look.polygonOffsetUnits = 1;
    this.ground = new THREE.Mesh(shape, look);
    this.space.add(this.ground);
    this.drawGrid(places, rows, columns);
  }

  // Height of the ground at a place, between the instants of its grid.
  heightAt(north, east) {
    const { ground } = this.scene;
    if (!ground) return 0;
    const along = (values, value) => {
      const step = (values[values.length - 1] - values[0]) / (values.length - 1);
      const at = Math.min(Math.max((value - values[0]) / step, 0), values.length - 1);
      const low = Math.min(Math.floor(at), values.length - 2);
      return [low, at - low];
    };
    const [i, up] = along(ground.north_m.data, north);
    const [j, right] = along(ground.east_m.data, east);
    const columns = ground.east_m.data.length;
    const height = (a, b) => ground.height_m.data[(i + a) * columns + j + b];
    return (1 - up) * ((1 - right) * height(0, 0) + right * height(0, 1)) + up * ((1 - right) * height(1, 0) + right * height(1, 1));
  }

  // A map under it all, from the tiles that this address has.
  layMap(template) {
    const { ground } = this.scene;
    if (ground?.mercator.length) layMap(this.ground, ground, template, this.remarks[1], this.onChange);
  }

  // Lines over the ground, to see slopes and distances by.
  drawGrid(places, rows, columns) {
    const point = (i, j) => new THREE.Vector3().fromArray(places, 3 * (i * columns + j));
    const points = [];
    const every = (count) => Math.max(Math.round((count - 1) / GRID), 1);
    for (let i = 0; i < rows; i += every(rows)) {
      for (let j = 0; j < columns - 1; j++) points.push(point(i, j), point(i, j + 1));
    }
    for (let j = 0; j < columns; j += every(columns)) {
      for (let i = 0; i < rows - 1; i++) points.push(point(i, j), point(i + 1, j));
    }
    const look = new THREE.LineBasicMaterial({ color: "#000000", transparent: true, opacity: 0.12 });
    this.space.add(new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), look));
  }

  drawZones() {
    const foot = this.low[2] - this.middle[2] - 0.02 * this.size;
    const top = Math.max(this.high[2] - this.middle[2], foot + HIGH * Math.min(this.reach, this.size));
    const bound = ([x, y]) => [
      Math.min(Math.max(x, this.low[0] - this.size), this.high[0] + this.size) - this.middle[0],
      Math.min(Math.max(y, this.low[1] - this.size), this.high[1] + this.size) - this.middle[1],
    ];
    this.zones = this.scene.zones.map((zone) => {
      const corners = [];
      const { data } = zone.corners_m;
      for (let n = 0; n < data.length; n += 2) corners.push(bound([data[n + 1], data[n]]));
      const colour = zone.keep_in ? "#1b7837" : "#c00000";
      const group = new THREE.Group();
      const walls = [];
      for (let n = 0; n < corners.length - 1; n++) {
        const [[a, b], [c, d]] = [corners[n], corners[n + 1]];
        walls.push(a, b, foot, c, d, foot, c, d, top, a, b, foot, c, d, top, a, b, top);
      }
      group.add(new THREE.Mesh(triangles(walls), flat(colour, zone.keep_in ? 0.1 : 0.28)));
      if (!zone.keep_in) {
        const lid = new THREE.ShapeGeometry(new THREE.Shape(corners.map(([x, y]) => new THREE.Vector2(x, y))));
        lid.translate(0, 0, top);
        group.add(new THREE.Mesh(lid, flat(colour, 0.18)));
      }
      for (const z of [foot, top]) {
        const edge = new THREE.BufferGeometry().setFromPoints(corners.map(([x, y]) => new THREE.Vector3(x, y, z)));
        group.add(new THREE.Line(edge, new THREE.LineBasicMaterial({ color: colour })));
      }
      this.space.add(group);
      return { zone, group };
    });
  }

  drawPlanned() {
    if (!this.scene.planned) return;
    const grey = this.scene.kind === "plan" ? null : "#555555";
    for (const [row, sysid] of this.scene.sysids.entries()) {
      const points = this.scene.track(this.scene.planned, row).filter(([, place]) => place);
      const shape = new THREE.BufferGeometry().setFromPoints(points.map(([, place]) => this.at(place)));
      const dash = this.size / 150;
      const look = grey
        ? new THREE.LineDashedMaterial({ color: grey, dashSize: dash, gapSize: dash, transparent: true, opacity: 0.6 })
        : new THREE.LineBasicMaterial({ color: colourOf(this.scene, sysid) });
      const line = new THREE.Line(shape, look);
      if (grey) line.computeLineDistances();
      this.space.add(line);
    }
  }

  // Rally points: a pole in the colour of each vehicle that returns there, with a cross on the ground.
  drawRally() {
    this.rally = [];
    if (!this.scene.rally_ned_m) return;
    const { data, shape } = this.scene.rally_ned_m;
    const arm = Math.max(this.size / 160, 0.3);
    for (const [row, sysid] of this.scene.sysids.entries()) {
      const points = [];
      for (let n = 0; n < shape[1]; n++) {
        const first = 3 * (row * shape[1] + n);
        const place = this.at([data[first], data[first + 1], data[first + 2]]);
        this.rally.push([data[first], data[first + 1], data[first + 2]]);
        for (const [x, y, z] of [[1, 1, 0], [1, -1, 0], [0, 0, 2]]) {
          const side = new THREE.Vector3(x, y, z).multiplyScalar(arm);
          points.push(z ? place.clone() : place.clone().sub(side), place.clone().add(side));
        }
      }
      const look = new THREE.LineBasicMaterial({ color: colourOf(this.scene, sysid), depthTest: false });
      this.space.add(new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(points), look));
    }
  }

  // The points of the drawn route, by name.
  drawPoints() {
    this.points = this.scene.points.map(({ name, place_ned_m: place }) => {
      const label = document.createElement("span");
      label.className = "point";
      label.textContent = name;
      this.labels.append(label);
      return { label, place: this.at(place.data), sure: name.split(" ").length > 1 };
    });
  }

  line(colour, opacity) {
    const look = new THREE.LineBasicMaterial({ color: colour, transparent: opacity < 1, opacity });
    const line = new THREE.LineSegments(new THREE.BufferGeometry(), look);
    line.frustumCulled = false;
    this.space.add(line);
    return line;
  }

  // Flown tracks in pieces between instants at which the place is known; `ends` counts them by time.
  drawTracks() {
    for (const [row, line] of this.tracks.entries()) {
      const points = this.scene.flownTrack(row);
      const places = [];
      line.userData.ends = [];
      for (let n = 1; n < points.length; n++) {
        const [first, second] = [points[n - 1][1], points[n][1]];
        if (first && second) places.push(this.at(first), this.at(second));
        line.userData.ends.push([points[n][0], places.length, second && this.at(second)]);
      }
      line.geometry.dispose();
      line.geometry = new THREE.BufferGeometry().setFromPoints(places);
    }
    this.survey?.update();
  }

  drawMarkers() {
    const { sysids } = this.scene;
    const dart = new THREE.ConeGeometry(0.62, 2, 4);
    dart.rotateY(Math.PI / 4);
    dart.scale(1, 1, 0.55); // points to y, that is north
    const drop = new THREE.OctahedronGeometry(0.8);
    // Seen through the ground: a vehicle on its pad reports itself metres off, also below it.
    const look = () => new THREE.MeshLambertMaterial({ color: 0xffffff, depthTest: false, transparent: true });
    this.darts = new THREE.InstancedMesh(dart, look(), sysids.length);
    this.balls = new THREE.InstancedMesh(drop, look(), sysids.length); // without a heading
    const hollow = new THREE.MeshBasicMaterial({ color: "#222222", wireframe: true });
    this.ghosts = new THREE.InstancedMesh(drop, hollow, sysids.length);
    const colour = new THREE.Color();
    for (const [row, sysid] of sysids.entries()) {
      colour.set(colourOf(this.scene, sysid));
      this.darts.setColorAt(row, colour);
      this.balls.setColorAt(row, colour);
    }
    for (const mesh of [this.darts, this.balls, this.ghosts]) {
      mesh.frustumCulled = false;
      mesh.renderOrder = 1;
      this.space.add(mesh);
    }
    this.names = sysids.slice(0, LABELS).map(() => this.labels.appendChild(document.createElement("span")));
  }

  resize(element) {
    const { clientWidth: width, clientHeight: height } = element;
    if (!width || !height) return;
    this.width = width;
    this.height = height;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    if (!this.isMoved) this.setView(this.view);
  }

  // Where the camera stands and looks, as east, north, up; null where the view decides that.
  get pose() {
    if (!this.isMoved) return null;
    return [this.camera.position, this.controls.target].map((one) => one.toArray().map((value, axis) => value + this.middle[axis]));
  }

  set pose(pose) {
    [this.camera.position, this.controls.target].forEach((one, n) => one.fromArray(pose[n].map((value, axis) => value - this.middle[axis])));
    this.isMoved = true;
  }

  // "all", "above", "chase", "side", or the number of a vehicle.
  setView(view) {
    this.view = view;
    this.isMoved = false;
    this.followed = null;
    if (view === "above") this.fit(new THREE.Vector3(0, -1e-3, 1));
    else if (view === "all") this.fit(new THREE.Vector3(-0.5, -0.9, 0.6));
    this.controls.enableRotate = view !== "above";
    this.controls.update();
  }

  // Look at the middle from a direction, from as near as shows all.
  fit(from) {
    const half = this.high.map((value, axis) => (value - this.low[axis]) / 2);
    const corners = [];
    for (const x of [-1, 1]) for (const y of [-1, 1]) for (const z of [-1, 1]) corners.push([x, y, z]);
    this.controls.target.set(0, 0, 0);
    for (let away = 0.5 * this.size; away < 8 * this.size; away *= 1.03) {
      this.camera.position.copy(from).setLength(away);
      this.camera.lookAt(this.controls.target);
      this.camera.updateMatrixWorld();
      const isSeen = (signs) => {
        const corner = new THREE.Vector3(...signs.map((sign, axis) => sign * half[axis])).project(this.camera);
        return Math.abs(corner.x) < 0.96 && Math.abs(corner.y) < 0.94 && corner.z < 1;
      };
      if (corners.every(isSeen)) return;
    }
  }

  // Show every vehicle at a time of the scene.
  show(t, vehicles) {
    this.follow(vehicles);
    for (const { zone, group } of this.zones) {
      const [north, east] = this.scene.moved(zone, t);
      group.position.set(east, north, 0);
    }
    for (const line of this.tracks) {
      const ends = line.userData.ends ?? [];
      let n = ends.length;
      while (n > 0 && ends[n - 1][0] > t) n--;
      line.geometry.setDrawRange(0, n ? ends[n - 1][1] : 0);
      line.userData.last = n ? ends[n - 1][2] : null;
    }
    if (this.scene.band) {
      this.band ??= new Band(this.space, this.scene);
      this.band.show(t, vehicles, (place) => this.at(place));
    }
    this.survey?.show(t);
    const matrix = new THREE.Matrix4();
    const none = new THREE.Matrix4().makeScale(0, 0, 0);
    const north = new THREE.Quaternion();
    const up = new THREE.Vector3(0, 0, 1);
    const errors = [];
    const drops = [];
    const tails = []; // from the last instant of a track to its vehicle
    this.markers = new Map();
    for (const [row, one] of vehicles.entries()) {
      const place = one.place && this.at(one.place);
      const planned = one.planned && this.at(one.planned);
      const hasHeading = Number.isFinite(one.heading);
      const pixel = place ? this.pixel(place) : 0;
      const most = Number.isFinite(one.apart) ? Math.max(0.3 * one.apart, 4 * pixel) : Infinity;
      const size = Math.min(MARKER_PX * pixel, most);
      if (place) {
        this.markers.set(one.sysid, place);
        if (Number.isFinite(one.above)) drops.push(place, place.clone().setZ(place.z - one.above));
        north.setFromAxisAngle(up, -(one.heading || 0));
        matrix.compose(place, north, new THREE.Vector3(size, size, size));
      }
      this.darts.setMatrixAt(row, place && hasHeading ? matrix : none);
      this.balls.setMatrixAt(row, place && !hasHeading ? matrix : none);
      if (place && planned) {
        errors.push(place, planned);
        matrix.compose(planned, north, new THREE.Vector3(size, size, size).multiplyScalar(0.8));
      }
      this.ghosts.setMatrixAt(row, place && planned && one.error > 2 * size ? matrix : none);
      const trail = place && this.tracks[row].userData;
      if (trail?.last) tails.push(trail.last, place);
    }
    for (const mesh of [this.darts, this.balls, this.ghosts]) mesh.instanceMatrix.needsUpdate = true;
    for (const [line, points] of [
      [this.errors, errors],
      [this.drops, drops],
      [this.tails, tails],
    ]) {
      line.geometry.dispose();
      line.geometry = new THREE.BufferGeometry().setFromPoints(points);
    }
    this.controls.update();
    this.renderer.render(this.space, this.camera);
    this.label(vehicles);
    this.drawScale();
  }

  // Metres that one pixel is at a place.
  pixel(place) {
    const away = this.camera.position.distanceTo(place);
    return (2 * away * Math.tan((FIELD_DEG * Math.PI) / 360)) / this.height;
  }

  // Write the numbers of vehicles beside them; those that would cover each other stand in one label.
  label(vehicles) {
    const limit = this.scene.limits.separation_m;
    const shown = [];
    this.labelPoints();
    for (const name of this.names) name.style.display = "none";
    for (const [n, { one, seen }] of this.inSight(vehicles).entries()) {
      const name = this.names[n];
      const at = [((seen.x + 1) * this.width) / 2 + 9, ((1 - seen.y) * this.height) / 2 - 20];
      const beside = shown.find((other) => {
        const [right, down] = [at[0] - other.at[0], at[1] - other.at[1]];
        return Math.abs(down) < LABEL_PX && right > -LABEL_PX && right < LABEL_PX * Math.min(other.numbers.length, NAMED + 1);
      });
      const group = beside ?? { name, at, numbers: [], isBad: false };
      if (!beside) shown.push(group);
      group.numbers.push(one.sysid === this.scene.leader ? `${one.sysid}★` : `${one.sysid}`);
      group.isBad ||= one.apart < limit;
    }
    for (const { name, at, numbers, isBad } of shown) {
      const more = numbers.length > NAMED ? ` +${numbers.length - NAMED}` : "";
      const text = numbers.slice(0, NAMED).join(" ") + more;
      if (name.textContent !== text) name.textContent = text;
      name.style.display = "";
      name.classList.toggle("bad", isBad);
      name.style.transform = `translate(${at[0]}px, ${at[1]}px)`;
    }
  }

  // The vehicles in sight, and where: of more than can have a number those nearest to the camera.
  inSight(vehicles) {
    const found = [];
    for (const one of vehicles) {
      const seen = this.markers.get(one.sysid)?.clone().project(this.camera);
      if (seen && Math.abs(seen.x) <= 1 && Math.abs(seen.y) <= 1 && Math.abs(seen.z) <= 1) found.push({ one, seen });
    }
    if (found.length <= LABELS) return found;
    return found.sort((a, b) => a.seen.z - b.seen.z).slice(0, LABELS);
  }

  // Write the names of route points where they are; a bare number gives way to what stands there already.
  labelPoints() {
    const taken = [];
    for (const { label, place } of [...this.points].sort((a, b) => b.sure - a.sure)) {
      const seen = place.clone().project(this.camera);
      const at = [((seen.x + 1) * this.width) / 2 + 4, ((1 - seen.y) * this.height) / 2 + 2];
      const isFree = taken.every(([x, y, wide]) => Math.abs(at[1] - y) > LABEL_PX || at[0] > x + wide || at[0] + 8 * label.textContent.length < x);
      const isShown = Math.abs(seen.x) < 1 && Math.abs(seen.y) < 1 && Math.abs(seen.z) < 1 && isFree;
      label.style.display = isShown ? "" : "none";
      if (!isShown) continue;
      taken.push([...at, 8 * label.textContent.length]);
      label.style.transform = `translate(${at[0]}px, ${at[1]}px)`;
    }
  }

  // Look at the whole formation from where it is widest, level with it, and move with its middle.
  followSide(vehicles) {
    const places = vehicles.filter((one) => one.place).map((one) => this.at(one.place));
    if (!places.length) return;
    const middle = places.reduce((sum, one) => sum.add(one), new THREE.Vector3()).divideScalar(places.length);
    if (this.followed) {
      this.camera.position.add(middle.clone().sub(this.followed));
    } else {
      let [xx, xy, yy] = [0, 0, 0];
      for (const place of places) {
        const [x, y] = [place.x - middle.x, place.y - middle.y];
        [xx, xy, yy] = [xx + x * x, xy + x * y, yy + y * y];
      }
      const widest = 0.5 * Math.atan2(2 * xy, xx - yy);
      const far = Math.max(...places.map((place) => place.distanceTo(middle)), 2);
      const from = new THREE.Vector3(Math.sin(widest), -Math.cos(widest), 0.06).normalize();
      const room = Math.min(1, this.width / this.height);
      this.camera.position.copy(middle).addScaledVector(from, (1.25 * far) / Math.tan((FIELD_DEG * Math.PI) / 360) / room);
    }
    this.controls.target.copy(middle);
    this.followed = middle;
  }

  // Move the camera with the leader, and as far away as the formation is wide; or with one vehicle.
  follow(vehicles) {
    if (this.view === "side") {
      this.followSide(vehicles);
      return;
    }
    const sysid = this.view === "chase" ? this.scene.leader || this.scene.sysids[0] : Number(this.view);
    const one = vehicles.find((vehicle) => vehicle.sysid === sysid);
    if (!one?.place) return;
    const place = this.at(one.place);
    if (this.followed) {
      this.camera.position.add(place.clone().sub(this.followed));
    } else {
      const others = vehicles.filter((other) => other.place).map((other) => this.at(other.place).distanceTo(place));
      const far = Math.min(Math.max(...others.sort((a, b) => a - b).slice(0, 12)), 0.3 * this.size);
      const back = this.view === "chase" ? Math.max(2.6 * far, 3) : Math.max(2.5 * (one.apart || 2), 2);
      const heading = Number.isFinite(one.heading) ? one.heading : 0;
      const from = new THREE.Vector3(-Math.sin(heading), -Math.cos(heading), 0.55).normalize();
      this.camera.position.copy(place).addScaledVector(from, back);
    }
    this.controls.target.copy(place);
    this.followed = place;
  }

  drawScale() {
    const pixel = this.pixel(this.controls.target);
    const length = niceStep(90 * pixel);
    this.scale.textContent = length >= 1000 ? `${length / 1000} km` : `${length} m`;
    this.scale.style.width = `${length / pixel}px`;
  }

  // North, east, down of a marker as it stands in space.
  placeOf(sysid) {
    const marker = this.markers?.get(sysid);
    if (!marker) return null;
    return [marker.y + this.middle[1], marker.x + this.middle[0], -(marker.z + this.middle[2])];
  }

  setDark(isDark) {
    this.space.background = new THREE.Color(isDark ? "#14181d" : "#dfe7ef");
    this.lights.forEach((light, n) => (light.intensity = LIGHTS[isDark][n]));
  }

  close() {
    this.resizing.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
  }
}

function flat(colour, opacity) {
  return new THREE.MeshBasicMaterial({
    color: colour,
    transparent: true,
    opacity,
    side: THREE.DoubleSide,
    depthWrite: false,
  });
}

function triangles(values) {
  const shape = new THREE.BufferGeometry();
  shape.setAttribute("position", new THREE.BufferAttribute(new Float32Array(values), 3));
  return shape;
}

export function niceStep(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= value * 0.999);
}
