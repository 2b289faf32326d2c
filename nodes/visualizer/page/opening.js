// Which panels are open when a graph is looked at for the first time.

const PICTURES = ["Keyframe", "Image", "Frames"];
const MOST_CAMERAS = 2, MOST_LABELS = 3;

/** For each of the first cameras its picture, its events and the labels that were asked for; then rates and graph. */
export function opening(topics) {
  const cameras = [...new Set(topics.map((t) => t.camera).filter(Boolean))].slice(0, MOST_CAMERAS);
  return [...cameras.flatMap((camera) => ofCamera(topics.filter((t) => t.camera === camera && !t.dormant))), { id: "rates" }, { id: "graph" }];
}

function ofCamera(mine) {
  const picture = PICTURES.map((type) => mine.find((t) => t.type === type)).find(Boolean);
  const events = mine.find((t) => t.type === "EventPacket");
  const labels = mine.find((t) => t.type === "Labels");
  const boxes = Boolean(labels?.asked.includes("boxes"));
  const specs = [picture, events].filter(Boolean).map((topic) => ({ ...specOf(topic), boxes }));
  return [...specs, ...(labels ? ofLabels(labels) : [])];
}

/** A panel for each of the first dense labels; the table where there are none and the boxes are not all. What a bag's
 * labels are shows with the first of them: all are waited for, and opened while less than `most` are open. */
function ofLabels(topic) {
  const kind = (wanted) => Object.keys(topic.views).filter((view) => topic.views[view] === wanted);
  const specs = (views, most) => views.map((view) => ({ ...specOf(topic, view), id: `${topic.name} ${view}`, pending: !topic.asked.length, most }));
  const pictures = specs(kind("image"), MOST_LABELS), tables = specs(kind("table"), 1);
  if (!topic.asked.length) return [...pictures, ...tables];
  if (pictures.length) return pictures.slice(0, MOST_LABELS);
  return topic.asked.some((label) => label !== "boxes") ? tables : [];
}

/** A panel of a topic, in its first view unless another is named. `pending`: it opens with the first thing to show. */
export function specOf(topic, view = Object.keys(topic.views)[0]) {
  return { id: topic.name, topic: topic.name, view, env: 0, pending: !topic.sure };
}
