// Parts of the operator's page. Nothing here is fetched from anywhere but the robot itself.
export { Scene } from "./scene.js";
export { HoldButton } from "./hold.js";
export { age, joules, metres, clock } from "./words.js";
