//! Statistics of the runs of a row.
//!
//! ```text
//! quantile q of x₁ ≤ … ≤ xₙ      x at 1 + (n − 1) q, interpolated linearly      (Hyndman and Fan 1996, type 7)
//! ```

use super::ending::Ending;
use super::result::Ran;
use super::study::{Column, Row, Study};
use std::collections::BTreeMap;

/// The runs of a row: how they ended, and their figures.
pub(super) struct Summary {
    pub row: Row,
    /// By seed.
    pub runs: Vec<(u64, Ran)>,
    /// The values of the runs in each column of the study, by key.
    figures: BTreeMap<&'static str, Spread>,
}

/// Statistics of a figure over several runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spread {
    /// How many runs have a value.
    pub count: usize,
    pub mean: f64,
    pub least: f64,
    pub lower_quartile: f64,
    pub median: f64,
    pub upper_quartile: f64,
    pub most: f64,
}

impl Spread {
    /// Names of the statistics in a CSV.
    pub const NAMES: [&'static str; 7] = [
        "count",
        "mean",
        "least",
        "lower_quartile",
        "median",
        "upper_quartile",
        "most",
    ];

    /// The statistics, in the order of their names.
    pub fn values(&self) -> [f64; 7] {
        [
            self.count as f64,
            self.mean,
            self.least,
            self.lower_quartile,
            self.median,
            self.upper_quartile,
            self.most,
        ]
    }

    /// Of finite values; `None` if there are none.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (least, most) = (*sorted.first()?, *sorted.last()?);
        let quantile = |share: f64| {
            let place = share * (sorted.len() - 1) as f64;
            let (below, above) = (place.floor() as usize, place.ceil() as usize);
            sorted[below] + place.fract() * (sorted[above] - sorted[below])
        };
        Some(Self {
            count: sorted.len(),
            mean: sorted.iter().sum::<f64>() / sorted.len() as f64,
            least,
            lower_quartile: quantile(0.25),
            median: quantile(0.5),
            upper_quartile: quantile(0.75),
            most,
        })
    }
}

impl Summary {
    /// A summary for each row of a study that has runs.
    pub fn all(study: &Study, runs: &[(u64, Ran)]) -> Vec<Self> {
        let of = |row: &Row| {
            let own = runs.iter().filter(|(_, ran)| ran.row == row.values);
            let mut own: Vec<(u64, Ran)> = own.cloned().collect();
            own.sort_by_key(|(seed, _)| *seed);
            let values = |column: &Column| -> Vec<f64> {
                own.iter().filter_map(|(_, ran)| (column.of)(ran)).collect()
            };
            let spread = |c: &Column| Some((c.key, Spread::of(&values(c))?));
            let figures = study.columns.iter().filter_map(spread);
            Self {
                row: row.clone(),
                figures: figures.collect(),
                runs: own,
            }
        };
        let rows = study.rows.iter().map(of);
        rows.filter(|summary| !summary.runs.is_empty()).collect()
    }

    /// The statistics of a column; `None` if no run has a value.
    pub fn figure(&self, key: &str) -> Option<Spread> {
        self.figures.get(key).copied()
    }

    /// How many runs ended in this way.
    pub fn ended(&self, ending: Ending) -> usize {
        let same = |(_, ran): &&(u64, Ran)| Ending::of(ran) == ending;
        self.runs.iter().filter(same).count()
    }

    /// Whether every run closed.
    pub fn all_closed(&self) -> bool {
        self.ended(Ending::Closed) == self.runs.len()
    }
}
