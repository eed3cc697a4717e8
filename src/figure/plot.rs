//! Curves over two axes.

/// One plot: two axes, any number of series, and guides to judge them by.
///
/// # Examples
/// ```
/// use sprung::figure::{Plot, Series};
///
/// let plot = Plot::log_log("Error of a first-order method", "step, s", "error")
///     .with_series(Series::line("measured", vec![(1e-3, 2e-3), (1e-2, 2e-2)]));
/// let svg = sprung::report::plot::svg(&plot);
/// assert!(svg.starts_with("<svg") && svg.contains("measured"));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// The title, in a few words.
    pub title: String,
    /// The conclusion, in a sentence; may be empty.
    pub conclusion: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// The measured points.
    pub series: Vec<Series>,
    /// Lines that theory expects.
    pub guides: Vec<Guide>,
}

impl Plot {
    /// A plot with two logarithmic axes, where a power law `y ∝ xᵖ` is a straight line of slope p.
    pub fn log_log(title: impl Into<String>, x: impl Into<String>, y: impl Into<String>) -> Self {
        Self::new(title, Axis::logarithmic(x), Axis::logarithmic(y))
    }

    /// A plot without series yet.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), conclusion: String::new(), x, y, series: Vec::new(), guides: Vec::new() }
    }

    /// Adds a conclusion.
    pub fn concluding(self, conclusion: impl Into<String>) -> Self {
        Self { conclusion: conclusion.into(), ..self }
    }

    /// Adds a series.
    pub fn with_series(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// Adds a guide.
    pub fn with_guide(mut self, guide: Guide) -> Self {
        self.guides.push(guide);
        self
    }

    /// True where a coordinate of any point is NaN.
    pub fn has_nan(&self) -> bool {
        self.series.iter().flat_map(|series| &series.points).any(|&(x, y)| x.is_nan() || y.is_nan())
    }
}

/// An axis: its title, with the unit, and its scale.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// The quantity and its unit.
    pub title: String,
    /// The spacing of its values.
    pub scale: Scale,
}

impl Axis {
    /// A linear axis.
    pub fn linear(title: impl Into<String>) -> Self {
        Self { title: title.into(), scale: Scale::Linear }
    }

    /// A logarithmic axis; only positive values have a place on it.
    pub fn logarithmic(title: impl Into<String>) -> Self {
        Self { title: title.into(), scale: Scale::Logarithmic }
    }
}

/// The spacing of the values of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences are equally long.
    Linear,
    /// Equal ratios are equally long.
    Logarithmic,
}

/// A named sequence of points.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// The name in the legend.
    pub name: String,
    /// The points (x, y) in the order in which they are joined.
    pub points: Vec<(f64, f64)>,
    /// The marks of its points.
    pub mark: Mark,
    /// The slope measured on the logarithmic axes, where one was; the legend states it.
    pub slope: Option<f64>,
    /// The name of the series whose colour this one has: of failures, that of the runs that did not fail.
    pub like: Option<String>,
    /// Its colour and shape; `None` for those of its place among the series.
    pub look: Option<Look>,
}

/// A colour and a shape by number, so that one thing looks the same in all pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Look {
    /// The number.
    pub number: usize,
    /// True for hollow markers: a variant of the thing that has the same number.
    pub hollow: bool,
}

impl Series {
    fn new(name: impl Into<String>, points: Vec<(f64, f64)>, mark: Mark) -> Self {
        Self { name: name.into(), points, mark, slope: None, like: None, look: None }
    }

    /// Points joined by a line.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::new(name, points, Mark::Line)
    }

    /// Points that stand alone.
    pub fn scatter(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::new(name, points, Mark::Point)
    }

    /// Points of what failed, drawn as crosses, by cause. One whose y (or x) has no place on its axis stands in a lane along the upper (the right) edge.
    pub fn failures(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self::new(name, points, Mark::Cross)
    }

    /// Gives it the colour of another series.
    pub fn like(self, name: impl Into<String>) -> Self {
        Self { like: Some(name.into()), ..self }
    }

    /// Sets its colour and shape.
    pub fn looking(self, look: Look) -> Self {
        Self { look: Some(look), ..self }
    }

    /// States the measured slope.
    pub fn with_slope(self, slope: f64) -> Self {
        Self { slope: Some(slope), ..self }
    }
}

/// The marks of the points of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A marker at every point and a line through them.
    Line,
    /// A marker at every point.
    Point,
    /// A cross at every point: a failure.
    Cross,
}

/// A thin line that says what to expect.
#[derive(Debug, Clone, PartialEq)]
pub enum Guide {
    /// On logarithmic axes, a line of this slope through a point; it has a meaning on those only.
    Slope {
        /// The expected slope.
        slope: f64,
        /// A point of the line.
        through: (f64, f64),
    },
    /// A horizontal line, for example a bound.
    Level {
        /// Its height.
        y: f64,
        /// Its meaning.
        label: String,
    },
    /// A vertical line, for example a critical step.
    Vertical {
        /// Its place.
        x: f64,
        /// Its meaning.
        label: String,
    },
}
