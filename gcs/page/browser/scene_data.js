// A scene as the server sends it, and every vehicle at a time: from the plan, from a recording, or from pictures.

// Where the values of each vehicle are, of curves that show the worst of them: in a scene, and in a picture.
const EACH = {
  "greatest position error": { of: "error_m", key: "error_m" },
  "greatest speed": { of: "speed_mps", motion: true, key: "speed_mps" },
};
const FORMS = { f4: Float32Array, i2: Int16Array, i4: Int32Array };

export function unpacked(value) {
  if (Array.isArray(value)) return value.map(unpacked);
  if (value === null || typeof value !== "object") return value;
  for (const [form, Numbers] of Object.entries(FORMS)) {
    if (form in value) {
      const bytes = Uint8Array.from(atob(value[form]), (character) => character.charCodeAt(0));
      return { data: new Numbers(bytes.buffer), shape: value.shape };
    }
  }
  return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, unpacked(one)]));
}

// A number in so many decimals; what rounds to zero has no sign.
export function fixed(value, decimals) {
  return value.toFixed(decimals).replace(/^-(?=[0.]+$)/, "");
}

const finite = (value) => (value === null || Number.isNaN(value) ? NaN : value);

export class SceneData {
  constructor(whole) {
    const { reported, ...scene } = whole.scene;
    Object.assign(this, unpacked(scene));
    this.told = unpacked(reported);
    this.times = this.t_s.data;
    this.isLive = this.kind === "flight";
    this.events = [...this.events];
    this.pictures = []; // of a flight under way, in order of time
    for (const picture of whole.pictures) this.add(picture);
    this.events.push(...whole.events);
    this.row = new Map(this.sysids.map((sysid, row) => [sysid, row]));
  }

  get begin() {
    return this.times[0];
  }

  get end() {
    return this.times[this.times.length - 1];
  }

  get newest() {
    return this.pictures[this.pictures.length - 1];
  }

  // A picture of a flight. Those of less than half a second replace each other, so that hours fit.
  add(picture) {
    picture.t_s = finite(picture.t_s);
    const before = this.pictures[this.pictures.length - 2];
    const replaced = this.newest && (Number.isNaN(this.newest.t_s) || this.newest.t_s - before?.t_s < 0.5);
    if (replaced) this.pictures.pop();
    this.pictures.push(picture);
  }

  // What a flight under way learns of its missions on board.
  take(name, value) {
    this[name] = unpacked(value);
  }

  // The last instant at or before a time, and how far the time is on the way to the next.
  at(t) {
    const times = this.times;
    let low = 0;
    let high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= t) low = middle;
      else high = middle - 1;
    }
    const next = Math.min(low + 1, times.length - 1);
    const share = next === low ? 0 : Math.min(Math.max((t - times[low]) / (times[next] - times[low]), 0), 1);
    return { low, next, share };
  }

  // North, east, down of a vehicle; null where it is not known.
  place(motion, row, { low, next, share }) {
    const { data, shape } = motion.places_ned_m;
    const first = 3 * (row * shape[1] + low);
    const second = 3 * (row * shape[1] + next);
    const found = [0, 1, 2].map((axis) => data[first + axis] + share * (data[second + axis] - data[first + axis]));
    if (!Number.isNaN(found[0])) return found;
    const alone = share < 0.5 ? first : second;
    return Number.isNaN(data[alone]) ? null : [data[alone], data[alone + 1], data[alone + 2]];
  }

  value(values, row, { low, next, share }) {
    return values.data[row * values.shape[1] + (share < 0.5 ? low : next)];
  }

  phase(t) {
    return this.phases.find((phase) => phase.begin_s <= t && t < phase.end_s)?.name ?? "";
  }

  // Whether the limit of the height above ground holds: not in take-off and landing, planned or ordered.
  isAloft(t) {
    if (["takeoff", "landing", ""].includes(this.phase(t)) || (this.lands_s ?? Infinity) <= t) return false;
    return !this.isLive || !this.pictureAt(t)?.step.startsWith("land");
  }

  // Every vehicle at a time; of a flight under way as it was reported last, if that is `isNow`.
  vehicles(t, isNow) {
    const at = this.at(t);
    if (this.isLive) return this.reported(isNow ? this.newest : this.pictureAt(t), t, at);
    const motion = this.flown ?? this.planned;
    const told = this.told;
    return this.sysids.map((sysid, row) => {
      const neighbour = this.value(motion.neighbour, row, at);
      const found = {
        sysid,
        place: this.place(motion, row, at),
        planned: this.flown && this.planned ? this.place(this.planned, row, at) : null,
        heading: this.value(motion.heading_rad, row, at),
        speed: this.value(motion.speed_mps, row, at),
        above: this.value(motion.above_ground_m, row, at),
        neighbour: neighbour < 0 ? 0 : this.sysids[neighbour],
        apart: this.value(motion.neighbour_m, row, at),
        needed: this.needed_pct ? this.value(this.needed_pct, row, at) : NaN,
      };
      if (!told) return found;
      const mode = this.value(told.mode, row, at);
      return {
        ...found,
        mode: mode < 0 ? "" : told.words[mode],
        armed: this.value(told.armed, row, at) === 1,
        battery: mode < 0 ? NaN : this.value(told.battery_pct, row, at),
        age: this.value(told.age_s, row, at),
        error: this.value(told.error_m, row, at),
        inBand: [null, false, true][this.value(told.in_band, row, at) + 1],
      };
    });
  }

  reported(picture, t, at) {
    if (!picture) return this.sysids.map((sysid) => ({ sysid, place: null }));
    const isPlanned = !Number.isNaN(picture.t_s) && t >= this.begin && t <= this.end;
    const planned = (row) => (isPlanned ? this.place(this.planned, row, at) : null);
    return picture.vehicles.map((one) => ({
      sysid: one.sysid,
      place: one.place_ned_m.includes(null) ? null : one.place_ned_m,
      planned: planned(this.row.get(one.sysid)),
      heading: finite(one.heading_rad),
      speed: finite(one.speed_mps),
      above: finite(one.above_ground_m),
      neighbour: one.neighbour,
      apart: finite(one.neighbour_m),
      mode: one.mode,
      armed: one.armed,
      battery: finite(one.battery_pct),
      age: one.link_age_s ?? Infinity,
      loss: finite(one.loss),
      error: finite(one.error_m),
      needed: isPlanned && this.needed_pct ? this.value(this.needed_pct, this.row.get(one.sysid), at) : NaN,
      inBand: (one.link_age_s ?? Infinity) > 2 ? null : one.in_band, // of a silent vehicle nobody knows
    }));
  }

  // The last picture at or before a time; the first for times before it.
  pictureAt(t) {
    for (let n = this.pictures.length - 1; n >= 0; n--) {
      if (this.pictures[n].t_s <= t) return this.pictures[n];
    }
    return this.pictures[0];
  }

  // The track that a vehicle has flown, as [time, place] for every instant; place is null where it is not known.
  flownTrack(row) {
    if (this.isLive) {
      const known = this.pictures.filter((picture) => !Number.isNaN(picture.t_s));
      return known.map(({ t_s, vehicles }) => {
        const place = vehicles[row].place_ned_m;
        return [t_s, place.includes(null) ? null : place];
      });
    }
    return this.flown ? this.track(this.flown, row) : [];
  }

  track(motion, row) {
    return Array.from(this.times, (t, n) => [t, this.place(motion, row, { low: n, next: n, share: 0 })]);
  }

  // The curves over time: [time, value] of what was flown and planned, and what the legend says at a time.
  curveLines() {
    const pairs = (values) => (values ? Array.from(values.data, (value, n) => [this.times[n], value]) : []);
    const behind = (curve) => (t) => {
      const { low, next, share } = this.at(t);
      const first = 2 * (share < 0.5 ? low : next);
      return [...curve.vehicles.data.slice(first, first + 2)];
    };
    const lines = this.curves.map((curve) => ({
      ...curve,
      flown: pairs(curve.flown),
      planned: pairs(curve.planned),
      true: pairs(curve.true),
      behind: behind(curve),
      each: this.each(curve.name),
    }));
    if (!this.isLive) return lines;
    const known = this.pictures.filter((picture) => !Number.isNaN(picture.t_s));
    // The value, and the vehicles behind it.
    const worst = (key, isWorse) => (picture) => {
      const ones = picture.vehicles.filter((one) => one[key] !== null);
      if (!ones.length) return [NaN, []];
      const one = ones.reduce((a, b) => (isWorse(b[key], a[key]) ? b : a));
      return [one[key], [one.sysid]];
    };
    const less = (a, b) => a < b;
    const more = (a, b) => a > b;
    const figures = {
      "least height above ground": worst("above_ground_m", less),
      "least separation": (picture) => [finite(picture.separation_m), picture.nearest],
      "greatest speed": worst("speed_mps", more),
      "greatest position error": worst("error_m", more),
      "formation error": (picture) => [finite(picture.formation_error_m), []],
    };
    const added = ["greatest position error", "formation error"].map((name) => ({
      name,
      unit: "m",
      planned: [],
      true: [],
    }));
    const grown = (curve) => ({
      ...curve,
      flown: known.map((picture) => [picture.t_s, figures[curve.name](picture)[0]]),
      behind: (t) => (known.length ? figures[curve.name](this.pictureAt(t))[1] : []),
      each: EACH[curve.name] ? this.eachReported(known, EACH[curve.name].key) : [],
    });
    return [...lines, ...added].map((curve) => (curve.name in figures ? grown(curve) : curve));
  }

  // The values of each vehicle behind a curve: [time, value] over all times; none where the curve has no such values.
  each(name) {
    const { of, motion } = EACH[name] ?? {};
    const values = of && (motion ? (this.flown ?? this.planned) : this.told)?.[of];
    if (!values) return [];
    return this.sysids.map((_, row) => Array.from(this.times, (t, n) => [t, values.data[row * this.times.length + n]]));
  }

  eachReported(pictures, key) {
    return this.sysids.map((_, row) => pictures.map(({ t_s, vehicles }) => [t_s, finite(vehicles[row][key])]));
  }

  // Displacement, north and east, of a zone at a time.
  moved(zone, t) {
    const times = zone.t_s.data;
    const way = zone.moved_m.data;
    let n = 0;
    while (n < times.length - 1 && times[n + 1] <= t) n++;
    if (n === times.length - 1 || t <= times[n]) return [way[2 * n], way[2 * n + 1]];
    const share = (t - times[n]) / (times[n + 1] - times[n]);
    return [0, 1].map((axis) => way[2 * n + axis] + share * (way[2 * n + 2 + axis] - way[2 * n + axis]));
  }
}
