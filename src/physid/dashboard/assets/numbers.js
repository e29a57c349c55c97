/* Numbers as people read them. */
const isNumber = (value) => typeof value === "number" && Number.isFinite(value);

function figure(value, digits = 4) {
  if (!isNumber(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) {
    const [mantissa, exponent] = value.toExponential(Math.max(digits - 2, 0)).split("e");
    return `${Number(mantissa)}e${Number(exponent)}`;
  }
  return String(Number(value.toPrecision(digits)));
}

function percent(value) {
  if (!isNumber(value)) return "–";
  const size = 100 * Math.abs(value);
  if (size === 0) return "0 %";
  if (size < 0.001) return "< 0.001 %";
  return `${Number((100 * value).toPrecision(size >= 1 ? 3 : 2))} %`;
}

/* A value with its unit; lengths in the unit that needs no power of ten. */
function measure(value, unit, digits = 3) {
  if (!isNumber(value)) return "–";
  if (unit !== "m") return `${figure(value, digits)} ${unit && unit !== "-" ? unit : ""}`.trim();
  const [scale, name] = [[1, "m"], [1e3, "mm"], [1e6, "µm"]].find(([scale]) => Math.abs(value) * scale >= 0.1) || [1, "m"];
  return `${figure(value * scale, digits)} ${name}`;
}

function duration(seconds) {
  if (!isNumber(seconds)) return "–";
  if (seconds < 120) return `${figure(seconds, 3)} s`;
  if (seconds < 7200) return `${figure(seconds / 60, 3)} min`;
  return `${figure(seconds / 3600, 3)} h`;
}

function moment(iso) {
  const date = new Date(iso);
  const two = (value) => String(value).padStart(2, "0");
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  return `${day} ${two(date.getHours())}:${two(date.getMinutes())}`;
}

/* How good a relative error is, as the paper's tables would see it. */
const grade = (error) => (error <= 0.01 ? "good" : error <= 0.1 ? "warn" : "bad");

/* A figure with the unit that its name implies: position errors are relative to the size of the object. */
function named(name, value) {
  if (!isNumber(value)) return "–";
  if (/position_error|relative_error/.test(name)) return percent(value);
  if (/rotation_error/.test(name)) return `${figure(value, 3)}°`;
  if (/seconds$/.test(name)) return duration(value);
  if (/psnr/.test(name)) return `${figure(value, 4)} dB`;
  return figure(value);
}

/* Whether less is better (-1), more is better (1), or neither (0). */
function direction(name) {
  if (/psnr|ssim|accuracy|coverage/.test(name)) return 1;
  return /error|loss|seconds|evaluations|deviation|train\//.test(name) ? -1 : 0;
}

function plural(count, word) {
  return `${count} ${word}${count === 1 ? "" : word.endsWith("s") ? "es" : "s"}`;
}
