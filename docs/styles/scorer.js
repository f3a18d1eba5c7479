// Order of search results: pages of the manual first, then reports, then the history of decisions and changes.
var Scorer = {
  score: (result) => {
    const [docname, , , , score] = result;
    const late = [[/^reports\//, 20], [/^(decisions|design)\//, 30], [/^(CHANGELOG|README|map|hardening)$/, 30]];
    const found = late.find(([where]) => where.test(docname));
    return score - (found ? found[1] : 0);
  },
  objNameMatch: 11, objPartialMatch: 6, objPrio: {0: 15, 1: 5, 2: -5}, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
