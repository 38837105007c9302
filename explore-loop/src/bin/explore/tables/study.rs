//! What a study is: the rows of its table, the runs behind each of them, the figures that are shown, and the plot.

use super::ending::Ending;
use super::result::Ran;
use super::summary::Summary;

/// A study: every row of its table summarises runs from the same seeds.
pub(super) struct Study {
    /// The name on the command line and of its files.
    pub name: &'static str,
    /// Heading of the table.
    pub title: &'static str,
    /// The question that it answers, and what it repeats of the paper.
    pub about: &'static str,
    /// Number of seeds by default, from 0.
    pub seeds: u64,
    /// Headings of the columns that identify a row.
    pub keys: &'static [&'static str],
    pub rows: Vec<Row>,
    pub columns: Vec<Column>,
    pub plot: Plot,
    /// Conclusions below the table, in lines of Markdown.
    pub remark: fn(&[Summary]) -> Vec<String>,
}

/// A row of the table.
#[derive(Clone)]
pub(super) struct Row {
    /// The values that identify the row, one for each key.
    pub values: Vec<String>,
    /// Options of `explore run` for this row.
    pub run: Vec<String>,
    /// Options of `explore replay`, if a replay of that run is measured instead; rows with the same run share its recording.
    pub replay: Option<Vec<String>>,
}

impl Row {
    /// A row whose runs are measured.
    pub fn explored(values: &[&str], run: &[&str]) -> Self {
        Self {
            values: owned(values),
            run: owned(run),
            replay: None,
        }
    }

    /// A row whose replays are measured.
    pub fn replayed(values: &[&str], run: &[&str], replay: &[&str]) -> Self {
        Self {
            replay: Some(owned(replay)),
            ..Self::explored(values, run)
        }
    }
}

fn owned(words: &[&str]) -> Vec<String> {
    words.iter().map(ToString::to_string).collect()
}

/// A figure of a run.
#[derive(Clone, Copy)]
pub(super) struct Column {
    /// Its name in the CSV, with the unit.
    pub key: &'static str,
    /// Its heading for people.
    pub heading: &'static str,
    pub of: fn(&Ran) -> Option<f64>,
    /// Digits after the point.
    pub digits: usize,
    pub show: Show,
    /// Which runs it is taken from, if not from all that have it; printed below the table.
    pub rule: Option<&'static str>,
}

/// Which statistic of the runs of a row is shown to people; the CSV has all.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Show {
    /// Median and quartiles.
    Median,
    /// The mean.
    Mean,
}

/// How a study is drawn.
#[derive(Clone, Copy)]
pub(super) enum Plot {
    /// Medians and quartiles over a numeric key, a panel for each column; a red cross where not all runs closed.
    Curves {
        over: usize,
        panels: &'static [&'static str],
    },
    /// The share explored before the first manipulation and what each later one added, a bar for each row.
    Explored,
    /// Medians and quartiles, a line for each row and a panel for each column.
    Whiskers { panels: &'static [&'static str] },
}

fn metrics(ran: &Ran) -> Option<&explore_loop::report::metrics::Metrics> {
    ran.metrics.as_ref()
}

macro_rules! column {
    ($name:ident, $key:literal, $heading:literal, $digits:literal, $of:expr) => {
        column!($name, $key, $heading, $digits, $of, Median);
    };
    ($name:ident, $key:literal, $heading:literal, $digits:literal, $of:expr, $show:ident) => {
        column!($name, $key, $heading, $digits, $of, $show, None);
    };
    ($name:ident, $key:literal, $heading:literal, $digits:literal, $of:expr, $show:ident, $rule:expr) => {
        pub(super) const $name: Column = Column {
            key: $key,
            heading: $heading,
            of: $of,
            digits: $digits,
            show: Show::$show,
            rule: $rule,
        };
    };
}

column!(
    MANIPULATIONS,
    "manipulations",
    "manipulations",
    1,
    |r| { (Ending::of(r) != Ending::Ours).then_some(metrics(r)?.manipulations as f64) },
    Mean,
    Some(
        "without runs ended by a system fault, which do not tell how many manipulations are needed"
    )
);
column!(
    NEEDED,
    "manipulations_needed",
    "manipulations needed, at least",
    2,
    |r| {
        match Ending::of(r) {
            Ending::Closed | Ending::Attached | Ending::Touching => {
                Some(metrics(r)?.manipulations.max(1) as f64)
            }
            Ending::Grips => Some(metrics(r)?.manipulations.max(MOST) as f64),
            Ending::Ours | Ending::Open => None,
        }
    },
    Mean,
    Some(
        "a run that closed counts its manipulations, at least 1; one that its grips ended counts 8, the most that a run makes unless more are \
         allowed; one ended by a system fault is not counted"
    )
);
column!(
    GAIN,
    "gain_percent",
    "gained by a manipulation, %",
    1,
    |r| {
        let m = metrics(r)?;
        let explored = m.explored_2eps.as_ref()?;
        let gained = explored.last()? - explored.first()?;
        (m.manipulations > 0).then(|| 100.0 * gained / m.manipulations as f64)
    },
    Mean,
    Some(
        "(explored at the end − explored at the start) / number of manipulations; over all runs that made any"
    )
);
column!(
    TROUBLES,
    "troubles",
    "given up on the way",
    1,
    |r| Some(metrics(r)?.troubles.len() as f64),
    Mean
);
column!(
    AT_START,
    "explored_at_start_percent",
    "explored at the start, %",
    1,
    |r| {
        metrics(r)?
            .explored_2eps
            .as_ref()?
            .first()
            .map(|e| 100.0 * e)
    }
);
column!(
    AT_END,
    "explored_at_end_percent",
    "explored at the end, %",
    1,
    |r| {
        metrics(r)?
            .explored_2eps
            .as_ref()?
            .last()
            .map(|e| 100.0 * e)
    }
);
column!(ACCURACY, "accuracy_mean_mm", "accuracy, mm", 2, |r| Some(
    1e3 * metrics(r)?.accuracy_m?.mean
));
column!(
    ACCURACY_P95,
    "accuracy_p95_mm",
    "accuracy p95, mm",
    2,
    |r| Some(1e3 * metrics(r)?.accuracy_m?.p95)
);
column!(
    COMPLETENESS,
    "completeness_mean_mm",
    "completeness, mm",
    2,
    |r| Some(1e3 * metrics(r)?.completeness_m?.mean)
);
column!(
    COMPLETENESS_P95,
    "completeness_p95_mm",
    "completeness p95, mm",
    2,
    |r| Some(1e3 * metrics(r)?.completeness_m?.p95)
);
column!(F_SCORE, "f_score_5mm_percent", "F at 5 mm, %", 1, |r| Some(
    100.0 * metrics(r)?.f_score?.at_5mm
));
column!(DOUBLED, "doubled_percent", "doubled, %", 1, |r| Some(
    100.0 * metrics(r)?.doubled?
));
column!(
    DIFFERENCE,
    "shape_difference_mm",
    "shape difference, mm",
    2,
    |r| Some(1e3 * metrics(r)?.shape_difference_m?)
);
column!(
    DIFFERENCE_REL,
    "shape_difference_percent",
    "shape difference, % of the size",
    2,
    |r| { Some(100.0 * metrics(r)?.shape_difference_rel?) }
);
column!(
    HIDDEN,
    "prediction_error_held_mm",
    "hidden while held, mm",
    2,
    |r| Some(1e3 * metrics(r)?.prediction_error_held_m?)
);
column!(FASTEST, "fastest_grip_mm_s", "fastest grip, mm/s", 0, |r| {
    Some(1e3 * metrics(r)?.fastest_grip_m_s?)
});
column!(SLIDE, "slide_mm", "slide, mm", 2, |r| Some(
    1e3 * metrics(r)?.slide_m?
));
column!(
    BELOW_TABLE,
    "below_table_mm",
    "deepest under the table, mm",
    3,
    |r| Some(1e3 * metrics(r)?.constraints.below_table_m)
);
column!(
    NON_MANIFOLD,
    "non_manifold_vertices",
    "non-manifold vertices",
    0,
    |r| Some(metrics(r)?.nm_remaining as f64)
);
column!(VERTICES, "vertices", "vertices", 0, |r| Some(
    metrics(r)?.vertices as f64
));
column!(
    REGISTRATION,
    "registration_median_ms",
    "registration, ms",
    1,
    |r| Some(metrics(r)?.registration_ms.median)
);
column!(ROBOT_TIME, "robot_time_s", "robot time, s", 1, |r| Some(
    metrics(r)?.robot_time_s
));

/// The most manipulations of a run unless another number is given.
pub(super) const MOST: usize = 8;
