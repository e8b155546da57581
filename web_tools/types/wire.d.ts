/** What travels between server and page, by page_states.py and page_events.py, which explain everything.
 * Made by `python -m web_tools.wire_types`. */

export interface Poster {
  node: string;
  window: [number, number, number, number];
  width: number;
  kind: "picture" | "side" | "video" | "view";
  clipped: boolean;
  label: string;
  color: "beside" | "body" | "face" | "fit" | "left_hand" | "right_hand" | null;
}

export interface Layout {
  mode: "poster" | "space";
  image: [number, number];
  posters: Poster[];
  wipe: boolean;
}

export interface FitBody {
  color: "beside" | "body" | "face" | "fit" | "left_hand" | "right_hand";
  points: ([number, number, number] | null)[];
  pelvis: number;
  error_bars: ([number, number] | null)[];
  unseen: number[];
  camera: [number, number, number, number];
  followed: [number, number, number] | null;
}

export interface Bodies {
  bodies: FitBody[];
  down: [number, number, number];
  floor: number;
}

export interface SidePlate {
  plate: [[number, number, number], [number, number, number]];
  shifts: [number, number][];
  metre: number;
  zero: number;
  floor: number | null;
  sight: [[number, number, number], [number, number, number]];
}

export interface View {
  image: [number, number];
  turn: [[number, number, number], [number, number, number], [number, number, number]];
  place: [number, number, number];
  camera: [number, number, number, number];
}

export interface Space {
  turn: [[number, number, number], [number, number, number], [number, number, number]];
  place: [number, number, number];
}

export interface OtherPerson {
  number: number;
  name: string;
  hint: string;
  at: [number, number] | null;
  bones: [number, number, number, number][];
}

export interface OtherPeople {
  people: OtherPerson[];
}

export interface Group {
  name: string;
  start: number;
  stop: number;
  radius: number;
}

export interface Skeleton {
  names: string[];
  groups: Group[];
  bones: [number, number][];
  hands: [number, number, number][];
}

export interface Keypoints {
  frame: number;
  xy: [number, number][];
  confidence: number[];
  bad: number[];
  edited: number[];
  pinned: number[];
  locked: number[];
  deep: number[];
  ignored: number[];
}

export interface Style {
  groups: string[];
  points: boolean;
  hand_along: boolean;
}

export interface Silhouette {
  lines: [number, number][][];
}

export interface StraightLines {
  along: [number, number, number, number][];
  other: [number, number, number, number][];
}

export interface Focus {
  x: number;
  y: number;
}

export interface Framing {
  around: string;
}

export interface Selection {
  joints: number[];
  suggested: boolean;
  view: boolean;
}

export interface Curve {
  label: string;
  color: "beside" | "body" | "face" | "fit" | "left_hand" | "right_hand";
  values: (number | null)[];
  error_bars: (number | null)[];
  unseen: [number, number][];
}

export interface Levels {
  parts: string[];
  words: string[];
  spans: [number, number][][][];
}

export interface Row {
  name: string;
  title: string;
  unit: string;
  curves: Curve[];
  levels: Levels | null;
  empty: string;
}

export interface Rows {
  rows: Row[];
}

export interface Choice {
  name: string;
  title: string;
  group: string;
}

export interface Timeline {
  length: number;
  frame_rate: number;
  first_frame: number;
  choices: Choice[];
}

export interface WrittenNote {
  first: number;
  last: number;
  text: string;
}

export interface Marks {
  edited: [number, number][];
  bad: [number, number][];
  flagged: [number, number][];
  checked: [number, number][];
  notes: WrittenNote[];
}

export interface MenuItem {
  label: string;
  action: string;
  more: MenuItem[];
  keys: string;
  obstacle: string;
}

export interface Menus {
  keypoints: MenuItem[][];
  picture: MenuItem[][];
  frames: MenuItem[][];
  timeline: MenuItem[][];
  nobody: MenuItem | null;
}

export interface Keyframes {
  frames: number[];
  subject: string;
}

export interface Suspicion {
  first: number;
  last: number;
  frame: number;
  key: string;
  score: number;
  reason: string;
}

export interface Suspicions {
  found: Suspicion[];
  looking: boolean;
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
  state: "done" | "fitting" | "found" | "phase1" | "phase2";
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
  live: number | null;
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
}

export interface Markup {
  html: string;
}

export interface Beat {
  milliseconds: number;
  number: number;
}

export interface ShowPanel {
  type: "show_panel";
  panel: string;
  field: string;
}

export interface CopyLink {
  type: "copy_link";
  frame: number;
  run: number;
  phase: number;
  person: number;
}

export interface Leave {
  type: "leave";
  to: "list" | "next" | "previous";
}

export interface StepsRead {
  type: "steps_read";
}

export interface SwitchTheme {
  type: "switch_theme";
}

export interface Hello {
  type: "hello";
  tab: string;
  width: number;
  height: number;
  browser: string;
  dark: boolean;
  hinted: boolean;
  plots: string[] | null;
}

export interface Theme {
  type: "theme";
  dark: boolean;
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

export interface OpenLink {
  type: "open_link";
  frame: number;
  run: number | null;
  phase: number | null;
  person: number | null;
}

export interface Plot {
  type: "plot";
  name: string;
  shown: boolean;
}

export interface MoveKey {
  type: "move_key";
  frame: number;
  to: number;
}

export interface LookAt {
  type: "look_at";
  entry: string;
}

export interface Select {
  type: "select";
  joints: number[];
  how: "add" | "replace" | "toggle";
  view: boolean;
}

export interface Drag {
  type: "drag";
  phase: "cancel" | "end" | "move" | "start";
  joints: number[];
  dx: number;
  dy: number;
  frame: number;
  view: boolean;
}

export interface DragDepth {
  type: "drag_depth";
  phase: "cancel" | "end" | "move" | "start";
  joint: number;
  metres: number;
  frame: number;
}

export interface Framed {
  type: "framed";
  left: number;
  top: number;
  right: number;
  bottom: number;
  frame: number;
}

export interface Press {
  type: "press";
  command: string;
  value: string;
}

export interface TooLarge {
  type: "too_large";
  name: string;
  size: number;
}

export interface Gesture {
  type: "gesture";
}

export interface GoToPerson {
  type: "go_to_person";
  person: number;
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
  event: Hello | Theme | Resized | Key | Seek | Range | Plot | MoveKey | LookAt | OpenLink | Select | Drag | DragDepth | Framed | Press | TooLarge | Gesture | GoToPerson | Drawn | Stranger;
}

export interface States {
  layout: Layout;
  bodies: Bodies;
  side: SidePlate;
  view: View;
  space: Space;
  other_people: OtherPeople;
  skeleton: Skeleton;
  keypoints: Keypoints;
  view_keypoints: Keypoints;
  style: Style;
  selection: Selection;
  framing: Framing;
  focus: Focus;
  timeline: Timeline;
  rows: Rows;
  marks: Marks;
  keyframes: Keyframes;
  menus: Menus;
  suspicions: Suspicions;
  fit: Fit;
  provenance: Provenance;
  range: ChosenRange;
  cursor: Cursor;
  keys: Keys;
  notice: Notice;
  header: Markup;
  bar: Markup;
  silhouette: Silhouette;
  straight_lines: StraightLines;
  beat: Beat;
}

export type PageRequest = ShowPanel | CopyLink | Leave | StepsRead | SwitchTheme;

export type PageEvent =
  Hello | Theme | Resized | Key | Seek | Range | OpenLink | Plot | MoveKey | LookAt | Select | Drag | DragDepth | Framed | Press | TooLarge | Gesture | GoToPerson | Drawn | Stranger;

/** Names of COLORS. */
export type Meaning =
  "accent" | "fit" | "beside" | "body" | "left_hand" | "right_hand" | "face" | "selected" | "suspicious" | "bad" | "checked" | "strong";
