// Which keypoints there are, where they are drawn, and which of them are on show.

let selected = new Set();
let suggested = false; // not the user has selected them
let hovered = null; // { joint, map }
let held = null; // keypoints that are drawn where the pointer has put them: { joints, from, dx, dy, frame, until }
let groupOf = []; // by keypoint: its group's place in skeleton.groups, which is also its rank for picking
let nameOf = [];

watch("skeleton", (skeleton) => {
  nameOf = skeleton?.names ?? [];
  groupOf = nameOf.map((_, joint) => skeleton.groups.findIndex(({ start, stop }) => start <= joint && joint < stop));
  invalidate("overlay");
});
watch("selection", (selection) => {
  selected = new Set(selection?.joints);
  suggested = Boolean(selection?.suggested);
  invalidate("overlay");
});
for (const name of ["style", "layout"]) watch(name, () => invalidate("overlay"));

let badJoints = new Set();
let editedJoints = new Set();
watch("keypoints", (keypoints) => {
  badJoints = new Set(keypoints?.bad);
  editedJoints = new Set(keypoints?.edited);
  if (held?.until && (keypoints?.frame !== held.frame || arrived(keypoints))) held = null;
  invalidate("overlay");
});

/** Whether the server shows the held keypoints where they were left; it rounds to a hundredth of a pixel. */
function arrived(keypoints) {
  const near = (a, b) => Math.abs(a - b) < 0.02;
  return [...held.joints].every((joint) => {
    const [x, y] = keypoints.xy[joint];
    const [fromX, fromY] = held.from[joint];
    return near(x, fromX + held.dx) && near(y, fromY + held.dy);
  });
}

/** In image pixels. */
function position(joint) {
  if (!held?.joints.has(joint)) return states.keypoints.xy[joint];
  const [x, y] = held.from[joint];
  return [x + held.dx, y + held.dy];
}

const groupShown = (joint) => states.style.groups.includes(states.skeleton.groups[groupOf[joint]].name);

/** Whether it is anywhere: undetected ones lie in the image's corner, and so do copies of them. */
function located(joint) {
  const { confidence, xy } = states.keypoints;
  return confidence[joint] > 0 || (editedJoints.has(joint) && xy[joint].some((pixels) => pixels !== 0));
}

/** Whether it is drawn, and can be picked. An undetected one is while it alone is selected: it can then be dragged from
 * the corner to its place. */
function shown(joint) {
  if (!groupShown(joint)) return false;
  if (selected.has(joint)) return selected.size === 1 || located(joint);
  const confidence = states.keypoints.confidence[joint];
  return states.style.points && confidence > 0 && confidence >= states.style.minimum;
}

/** All there is to draw, or nothing while some of it is missing. */
const skeletonReady = () =>
  states.layout?.mode === "poster" && Boolean(states.skeleton && states.style && states.keypoints);

const shownJoints = () => (skeletonReady() ? nameOf.map((_, joint) => joint).filter(shown) : []);
