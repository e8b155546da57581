/** What tcfit uses of viser's page and of the three.js objects in it. viser documents none of it. */

export interface Matrix4 {
  elements: number[];
  clone(): Matrix4;
  copy(other: Matrix4): Matrix4;
  multiply(other: Matrix4): Matrix4;
  equals(other: Matrix4): boolean;
}

export interface Vector3 {
  x: number;
  y: number;
  z: number;
  clone(): Vector3;
  set(x: number, y: number, z: number): Vector3;
  applyMatrix4(matrix: Matrix4): Vector3;
}

export interface Texture {
  image: ImageBitmap;
  colorSpace: string;
  flipY: boolean;
  generateMipmaps: boolean;
  magFilter: number;
  minFilter: number;
  needsUpdate: boolean;
  dispose(): void;
}

export interface Material {
  map?: Texture | null;
  color: { setScalar(value: number): void };
  vertexColors: boolean;
  colorWrite: boolean;
  transparent: boolean;
  needsUpdate: boolean;
  userData: Record<string, unknown>;
  clone(): Material;
}

export interface Attribute {
  array: Float32Array;
  needsUpdate: boolean;
}

export interface Object3D {
  matrixWorld: Matrix4;
  parent: Object3D | null;
  visible: boolean;
  renderOrder: number;
  userData: { [name: string]: any };
  isMesh?: boolean;
  position: Vector3;
  add(child: Object3D): void;
  updateMatrixWorld(force: boolean): void;
  traverse(visit: (child: any) => void): void;
}

export interface Mesh extends Object3D {
  material: Material;
  geometry: { attributes: { [name: string]: Attribute }; setAttribute(name: string, attribute: Attribute): void };
  onBeforeRender: (renderer: Renderer) => void;
  onAfterRender: (renderer: Renderer) => void;
  raycast: () => void;
}

export interface Camera {
  position: Vector3;
  projectionMatrix: Matrix4;
  matrixWorldInverse: Matrix4;
}

export interface Renderer {
  setScissor(x: number, y: number, width: number, height: number): void;
  setScissorTest(on: boolean): void;
  render(scene: Scene, camera: Camera): void;
}

export interface Scene {
  onBeforeRender?: (renderer: unknown, scene: Scene, camera: Camera) => void;
  __r3f?: { root: { getState(): { invalidate(): void; gl: Renderer } } };
  onAfterRender?: (renderer: unknown, scene: Scene, camera: Camera) => void;
}

export interface CameraControl {
  mouseButtons: { [name: string]: number };
  touches: { [name: string]: number };
  dollyToCursor: boolean;
}

export interface Message {
  type: string;
  name?: any;
  source?: any;
  updates?: any;
}

export interface Viewer {
  canvas: HTMLCanvasElement;
  camera: Camera;
  cameraControl: CameraControl | null;
  scene: Scene;
  nodeRefFromName: { [name: string]: Object3D | undefined };
  messageQueue: Message[];
  drainMessageQueue: (() => void) | null;
  getRenderRequestState: string;
  requestRender: () => void;
  sendMessage: (message: Message) => void;
  syncCanvasSize: ((width: number, height: number) => void) | null;
}

/** What the server's scripts call. Until the modules are there it keeps the calls for them. */
export interface Tcfit {
  version: string;
  viser: string;
  calls?: [name: string, values: any[]][];
  [name: string]: any;
}

declare global {
  interface Window {
    __viserMutable: Viewer;
    tcfit: Tcfit;
  }
}
