// Figures as words; null means unknown.
export function age(s) {
  if (s === null || s === undefined) return "never";
  return s < 1 ? `${Math.round(s * 1000)} ms` : s < 100 ? `${s.toFixed(1)} s` : "long ago";
}

export function joules(j) {
  if (j === null || j === undefined) return "unknown";
  return Math.abs(j) >= 1000 ? `${(j / 1000).toFixed(1)} kJ` : `${Math.round(j)} J`;
}

export function metres(m) {
  return m === null || m === undefined ? "unknown" : `${m.toFixed(1)} m`;
}

export function clock(s) {
  const whole = Math.max(0, Math.floor(s || 0));
  return `${String(Math.floor(whole / 60)).padStart(2, "0")}:${String(whole % 60).padStart(2, "0")}`;
}
