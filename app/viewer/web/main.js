// The page's scripts. Loaded before the template is mounted.
import { watchServer } from "./watch.js";
import { soundAlarm } from "./alarm.js";
import { listenToKeys } from "./keys.js";
import { makeAccessible } from "./accessible.js";
import { drawHere } from "./client.js";
import { showUltrasound } from "./ultrasound.js";
import { showTimeline } from "./timeline.js";
import { listenToOperator } from "./operator.js";
import { editContour } from "./contour.js";
import { calibrateTool } from "./calibration.js";
import { registerRobot } from "./registration.js";
import { chooseTools } from "./tool_choice.js";
import { editWorld } from "./world.js";

const updateAlarm = soundAlarm(window.trame);
const drawn = window.trame.state.get("title").client ? drawHere(window.trame) : null;
watchServer(window.trame, updateAlarm, drawn);
listenToKeys(window.trame);
if (window.trame.state.get("title").images.length) showUltrasound(window.trame);
if (window.trame.state.get("title").contour) editContour(window.trame);
showTimeline(window.trame);
if (window.trame.state.get("role") === "operate") chooseTools(window.trame);
if (window.trame.state.get("title").live) calibrateTool(window.trame);
if (window.trame.state.get("title").live) registerRobot(window.trame);
if (window.trame.state.get("role") === "operate") editWorld(window.trame);
if (window.trame.state.get("role") === "operate") listenToOperator(window.trame);
makeAccessible();
