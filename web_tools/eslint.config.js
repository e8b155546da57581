import js from "@eslint/js";
import globals from "globals";

export default [
  js.configs.recommended,
  {
    languageOptions: { ecmaVersion: 2022, sourceType: "module", globals: globals.browser },
    linterOptions: { reportUnusedDisableDirectives: true },
    rules: {
      eqeqeq: "error",
      "no-shadow": "error",
      "no-var": "error",
      "prefer-const": "error",
      "no-unused-vars": ["error", { argsIgnorePattern: "^_", ignoreRestSiblings: true }],
      "max-len": ["error", { code: 120, ignoreTemplateLiterals: true }],
    },
  },
  // A page of its own, which is opened as a file: browsers load no modules there.
  { files: ["tcfit_app/batch/*.js"], languageOptions: { sourceType: "script" } },
];
