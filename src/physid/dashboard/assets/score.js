/* How well a diagnosis does on a bank of recordings with hidden effects: its figures with intervals, then the tables. */

/* Whether a figure keeps what is asked in words such as "<= 5", ">= 95" or "80 to 97"; null where nothing is asked. */
function keeps(value, asked) {
  const number = "(-?[\\d.]+)";
  const [, sign, limit] = new RegExp(`^(<=|>=) ${number}$`).exec(asked || "") || [];
  const [, low, high] = new RegExp(`^${number} to ${number}$`).exec(asked || "") || [];
  if (!isNumber(value) || (!sign && !low)) return null;
  if (low) return value >= Number(low) && value <= Number(high);
  return sign === "<=" ? value <= Number(limit) : value >= Number(limit);
}

const scoreMark = (each) => {
  if (keeps(each.value, each.wanted)) return badge("as wanted", "good");
  return { true: badge("good", "good"), false: badge("missed", "bad"), null: "" }[String(keeps(each.value, each.good))];
};

function judgedFigures(run) {
  return run.score.figures.map((each) => keeps(each.value, each.good)).filter((each) => each !== null);
}

function scoreSections(run) {
  const { bank, figures, tables } = run.score;
  const columns = [
    { title: "Figure", cell: (each) => each.name },
    { title: "Value", right: true, cell: (each) => measure(each.value, each.unit) },
    { title: "95 % interval", right: true, cell: (each) => (isNumber(each.low) ? `${figure(each.low, 3)} to ${figure(each.high, 3)}` : "") },
    { title: "Sets", right: true, cell: (each) => each.count },
    { title: "Good", right: true, cell: (each) => each.good },
    { title: "Wanted", right: true, cell: (each) => each.wanted },
    { title: "", cell: scoreMark },
  ];
  return [
    h("p", { class: "soft small" }, `${bank.sets} sets, sealed: SHA-256 of the labels `, h("span", { class: "hash" }, bank.seal)),
    section("Figures", table(columns, figures)),
    Object.entries(tables).filter(([, rows]) => rows.length > 1).map(([title, [head, ...rows]]) =>
      section(title, table(head.map((name, index) => ({ title: name, cell: (row) => row[index] })), rows))),
  ];
}
