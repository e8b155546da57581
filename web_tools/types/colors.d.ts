/** Made by the server from COLORS of fitting_core/render/colors.py: on dark ground, on light ground. */

import type { Meaning } from "./wire";

export const COLORS: { [meaning in Meaning]: [dark: string, light: string] };
