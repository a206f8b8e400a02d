// A zone drawn on the map: press at its centre, drag to its edge. And the way of a plan that is proposed.
import { THREE } from "nicegui-scene";

const LOOK = { color: "#d000d0", depthTest: false };
const CORNERS = 64;

export class ZoneDrawing {
  constructor(world) {
    this.world = world;
    this.ring = this.line();
    this.ways = [];
    this.rays = new THREE.Raycaster();
    const canvas = world.renderer.domElement;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    canvas.addEventListener("pointerup", () => this.release());
  }

  // Have the next press and drag draw a zone; `onDrawn` gets [north, east, radius] in m.
  begin(onDrawn) {
    this.onDrawn = onDrawn;
    this.world.controls.enabled = false;
    this.world.renderer.domElement.style.cursor = "crosshair";
  }

  get isOn() {
    return !this.world.controls.enabled;
  }

  end() {
    this.centre = null;
    this.world.controls.enabled = true;
    this.world.renderer.domElement.style.cursor = "";
  }

  press(event) {
    if (!this.isOn || event.button !== 0) return;
    this.centre = this.placeAt(event);
    event.target.setPointerCapture(event.pointerId);
  }

  drag(event) {
    const edge = this.isOn && this.centre && this.placeAt(event);
    if (!edge) return;
    this.radius = Math.hypot(edge[0] - this.centre[0], edge[1] - this.centre[1]);
    this.showZone(...this.centre, this.radius);
  }

  release() {
    if (!this.isOn || !this.centre || !(this.radius > 0)) return;
    const drawn = [...this.centre, this.radius];
    this.end();
    this.radius = 0;
    this.onDrawn(drawn);
  }

  // North and east of what is seen under the pointer, on the ground.
  placeAt({ offsetX, offsetY }) {
    const { world } = this;
    const at = new THREE.Vector2((2 * offsetX) / world.width - 1, 1 - (2 * offsetY) / world.height);
    this.rays.setFromCamera(at, world.camera);
    const found = world.ground && this.rays.intersectObject(world.ground)[0]?.point;
    const level = new THREE.Plane(new THREE.Vector3(0, 0, 1), world.middle[2] - world.low[2]);
    const place = found ?? this.rays.ray.intersectPlane(level, new THREE.Vector3());
    return place && [place.y + world.middle[1], place.x + world.middle[0]];
  }

  showZone(north, east, radius) {
    const points = Array.from({ length: CORNERS + 1 }, (_, n) => {
      const angle = (2 * Math.PI * n) / CORNERS;
      const [a, b] = [north + radius * Math.cos(angle), east + radius * Math.sin(angle)];
      return this.world.at([a, b, -(this.world.heightAt(a, b) + 0.3)]);
    });
    this.set(this.ring, points);
  }

  // Show the tracks of a plan, (V, N, 3) north, east, down.
  showWay({ data, shape: [vehicles, count] }) {
    this.ways = Array.from({ length: vehicles }, (_, row) => {
      const first = 3 * row * count;
      const points = Array.from({ length: count }, (_, n) => this.world.at(data.slice(first + 3 * n, first + 3 * n + 3)));
      const line = this.line();
      this.set(line, points);
      return line;
    });
    this.world.onChange();
  }

  clear() {
    for (const line of this.ways) this.world.space.remove(line);
    this.ways = [];
    this.set(this.ring, []);
    if (this.isOn) this.end();
  }

  line() {
    const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial(LOOK));
    line.frustumCulled = false;
    line.renderOrder = 2;
    this.world.space.add(line);
    return line;
  }

  set(line, points) {
    line.geometry.dispose();
    line.geometry = new THREE.BufferGeometry().setFromPoints(points);
    this.world.onChange();
  }
}
