// The band of a mission on board: where a vehicle may be now, early or late, and so far beside its predicted track.
import { THREE } from "nicegui-scene";

const PIECES = 6; // of the band of one vehicle
const IN = new THREE.Color("#009e73");
const OUT = new THREE.Color("#d03020");

export class Band {
  constructor(space, scene) {
    this.scene = scene;
    const look = { color: 0xffffff, transparent: true, opacity: 0.12, depthWrite: false };
    const count = scene.sysids.length * PIECES;
    const tube = new THREE.CylinderGeometry(1, 1, 1, 12, 1, true);
    this.tubes = new THREE.InstancedMesh(tube, new THREE.MeshBasicMaterial(look), count);
    this.balls = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 12, 8), new THREE.MeshBasicMaterial(look), 2 * scene.sysids.length);
    for (const mesh of [this.tubes, this.balls]) {
      mesh.frustumCulled = false;
      space.add(mesh);
    }
  }

  // The places of a vehicle's band at a time, from the earliest to the latest; none where nothing is predicted.
  places(row, t) {
    const { band } = this.scene;
    const late = band.late_s.data[row];
    const steps = Array.from({ length: PIECES + 1 }, (_, n) => t + late * ((2 * n) / PIECES - 1));
    return steps.map((at) => this.scene.place(band, row, this.scene.at(at))).filter((place) => place);
  }

  show(t, vehicles, at) {
    const { band } = this.scene;
    const none = new THREE.Matrix4().makeScale(0, 0, 0);
    const matrix = new THREE.Matrix4();
    const turned = new THREE.Quaternion();
    const along = new THREE.Vector3();
    const up = new THREE.Vector3(0, 1, 0);
    const is = (mesh, n, value, colour) => {
      mesh.setMatrixAt(n, value);
      if (colour) mesh.setColorAt(n, colour);
    };
    for (const [row, one] of vehicles.entries()) {
      const isShown = one.inBand !== null && one.inBand !== undefined;
      const points = isShown ? this.places(row, t).map(at) : [];
      const colour = one.inBand ? IN : OUT;
      for (let n = 0; n < PIECES; n++) {
        const [first, second] = [points[n], points[n + 1]];
        const length = first && second ? along.subVectors(second, first).length() : 0;
        if (length < 1e-6) {
          is(this.tubes, row * PIECES + n, none);
          continue;
        }
        turned.setFromUnitVectors(up, along.divideScalar(length));
        const middle = first.clone().add(second).multiplyScalar(0.5);
        matrix.compose(middle, turned, new THREE.Vector3(band.off_m, length, band.off_m));
        is(this.tubes, row * PIECES + n, matrix, colour);
      }
      for (const [n, end] of [points[0], points[points.length - 1]].entries()) {
        matrix.makeScale(band.off_m, band.off_m, band.off_m);
        if (end) matrix.setPosition(end);
        is(this.balls, 2 * row + n, end ? matrix : none, colour);
      }
    }
    for (const mesh of [this.tubes, this.balls]) {
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
  }
}
