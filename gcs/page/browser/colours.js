// The colours of vehicles: those of Okabe and Ito, which the colour-blind can tell apart. Numbers tell the rest.

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f3fbf", "#8b5a2b"];

export function colourOf(scene, sysid) {
  return COLOURS[scene.row.get(sysid) % COLOURS.length];
}
