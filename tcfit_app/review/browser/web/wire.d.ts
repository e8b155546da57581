/** What travels between server and page, by page_states.py and page_events.py, which explain everything.
 * Made by `python -m tests.drivers.wire_types`. */

export interface Poster {
  x: number;
  label: string;
  color: string;
}

export interface Layout {
  mode: "poster" | "space";
  image: [number, number];
  posters: Poster[];
}

export interface Group {
  name: string;
  start: number;
  stop: number;
  color: string;
  radius: number;
}

export interface Skeleton {
  names: string[];
  groups: Group[];
  bones: [number, number][];
}

export interface Keypoints {
  frame: number;
  xy: [number, number][];
  confidence: number[];
  bad: number[];
  edited: number[];
  detections: [number, number, number][];
}

export interface Style {
  groups: string[];
  color_by: "confidence" | "group";
  points: boolean;
  bones: boolean;
  minimum: number;
  ghosts: boolean;
}

export interface Selection {
  joints: number[];
  suggested: boolean;
}

export interface Curve {
  label: string;
  color: string;
  values: (number | null)[];
}

export interface Timeline {
  length: number;
  frame_rate: number;
  first_frame: number;
  title: string;
  unit: string;
  curves: Curve[];
  empty: string;
}

export interface Marks {
  edited: [number, number][];
  bad: [number, number][];
  flagged: [number, number][];
  checked: [number, number][];
  apart: [number, number][];
}

export interface Origins {
  label: string;
  texts: string[];
  which: number[];
}

export interface Provenance {
  fits: Origins[];
}

export interface FitSpan {
  first: number;
  last: number;
  state: "done" | "fitting" | "phase1" | "phase2";
}

export interface Fit {
  spans: FitSpan[];
}

export interface ChosenRange {
  first: number;
  last: number;
}

export interface Cursor {
  frame: number;
  playing: boolean;
}

export interface KeyBinding {
  key: string;
  action: string;
  shift: boolean;
  ctrl: boolean;
}

export interface Keys {
  bindings: KeyBinding[];
}

export interface Notice {
  title: string;
  text: string;
  kind: "error" | "info";
  progress: number | null;
}

export interface Chip {
  text: string;
  kind: "busy" | "error" | "good" | "info" | "warning";
  progress: number | null;
}

export interface Chips {
  chips: Chip[];
}

export interface Beat {
  milliseconds: number;
}

export interface Legend {
  title: string;
  unit: string;
  low: number;
  high: number;
  colors: string[];
}

export interface Hello {
  type: "hello";
  tab: string;
  width: number;
  height: number;
}

export interface Resized {
  type: "resized";
  width: number;
  height: number;
}

export interface Key {
  type: "key";
  action: string;
  repeat: boolean;
}

export interface Seek {
  type: "seek";
  frame: number;
}

export interface Range {
  type: "range";
  first: number | null;
  last: number | null;
}

export interface Select {
  type: "select";
  joints: number[];
  how: "add" | "replace" | "toggle";
}

export interface Drag {
  type: "drag";
  phase: "cancel" | "end" | "move" | "start";
  joints: number[];
  dx: number;
  dy: number;
  frame: number;
}

export interface Press {
  type: "press";
  command: string;
  value: string;
}

export interface Gesture {
  type: "gesture";
}

export interface Drawn {
  type: "drawn";
  frame: number;
}

export interface Stranger {
  type: "stranger";
  viser: string;
  missing: string[];
}

export interface Envelope {
  number: number;
  event: Hello | Resized | Key | Seek | Range | Select | Drag | Press | Gesture | Drawn | Stranger;
}

export interface States {
  layout: Layout;
  skeleton: Skeleton;
  keypoints: Keypoints;
  style: Style;
  selection: Selection;
  timeline: Timeline;
  marks: Marks;
  fit: Fit;
  provenance: Provenance;
  range: ChosenRange;
  cursor: Cursor;
  keys: Keys;
  notice: Notice;
  chips: Chips;
  legend: Legend;
  beat: Beat;
}

export type PageEvent =
  Hello | Resized | Key | Seek | Range | Select | Drag | Press | Gesture | Drawn | Stranger;
