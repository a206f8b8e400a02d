// A map under the scene, from square tiles of the web: only where `--tiles` names an address.
import { THREE } from "nicegui-scene";

const TILE = 256; // pixels
const WIDE = 2048; // pixels of a map, about
const DEEPEST = 19;
const OWNERS = { "openstreetmap.org": "© OpenStreetMap contributors" };

// Lay the map on the mesh of a ground, and say in `label` whose it is.
export function layMap(mesh, ground, template, label, onChange) {
  const [x, y] = [0, 1].map((axis) => ground.mercator.map((corner) => corner[axis]));
  const span = Math.max(Math.max(...x) - Math.min(...x), Math.max(...y) - Math.min(...y));
  const zoom = Math.min(Math.max(Math.floor(Math.log2(WIDE / TILE / span)), 0), DEEPEST);
  const tiles = 2 ** zoom;
  const [left, right, top, bottom] = [
    [Math.min, x],
    [Math.max, x],
    [Math.min, y],
    [Math.max, y],
  ].map(([pick, values]) => Math.floor(pick(...values) * tiles));
  const [wide, high] = [right - left + 1, bottom - top + 1];
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [wide * TILE, high * TILE];
  const pen = canvas.getContext("2d");
  pen.fillStyle = "#d8d2c4";
  pen.fillRect(0, 0, canvas.width, canvas.height);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.anisotropy = 4;
  const [rows, columns] = [ground.north_m.data.length, ground.east_m.data.length];
  const places = new Float32Array(2 * rows * columns);
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      const [north, east] = [i / (rows - 1), j / (columns - 1)];
      const between = (c) => (1 - north) * ((1 - east) * c[0] + east * c[1]) + north * ((1 - east) * c[2] + east * c[3]);
      places.set([(between(x) * tiles - left) / wide, 1 - (between(y) * tiles - top) / high], 2 * (i * columns + j));
    }
  }
  mesh.geometry.setAttribute("uv", new THREE.BufferAttribute(places, 2));
  mesh.material.map = texture;
  mesh.material.vertexColors = false;
  mesh.material.needsUpdate = true;
  const { hostname } = new URL(template.replace(/[{}]/g, ""));
  const owner = Object.entries(OWNERS).find(([name]) => hostname.endsWith(name))?.[1] ?? hostname;
  let missing = 0;
  const say = () => (label.textContent = `map: ${owner}${missing ? `, ${missing} of ${wide * high} tiles missing` : ""}`);
  say();
  for (let column = 0; column < wide; column++) {
    for (let row = 0; row < high; row++) {
      const image = new Image();
      image.crossOrigin = "anonymous";
      image.referrerPolicy = "origin"; // some servers want to know who asks; the token stays here
      image.onload = () => {
        pen.drawImage(image, column * TILE, row * TILE, TILE, TILE);
        texture.needsUpdate = true;
        onChange();
      };
      image.onerror = () => {
        missing += 1;
        say();
      };
      const numbers = { z: zoom, x: (left + column + tiles) % tiles, y: top + row };
      image.src = template.replace(/\{([zxy])\}/g, (_, name) => numbers[name]);
    }
  }
}
