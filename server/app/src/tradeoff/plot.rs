//! The plots: error against load, and the profile of a scene without tools.

use kerf_plot::{Axis, BLACK, COLOURS, Chart, Curve, Figure, GREY, PALE};
use kerf_scenes::dial::{ParetoFront, ParetoPoint};

use super::process::Run;
use super::report::{is_on_pareto_front, label};
use super::sweep;

/// Least error drawn, %: a logarithm has no 0, which the reference's own setting has.
const LEAST_PERCENT: f64 = 1e-3;

/// `pareto`: error against load, numbered; dominated settings are pale.
pub fn pareto(pareto: &ParetoFront) -> Figure {
    let (mut best, dominated): (Vec<&ParetoPoint>, Vec<&ParetoPoint>) =
        pareto.points.iter().partition(|point| is_on_pareto_front(point, pareto));
    best.sort_by(|a, b| a.load().total_cmp(&b.load()));
    let places = |points: &[&ParetoPoint]| points.iter().map(|point| place(point)).collect::<Vec<_>>();
    let errors = || pareto.points.iter().map(|point| place(point).1);
    let (least, most) = (errors().fold(f64::INFINITY, f64::min), errors().fold(0.0, f64::max));
    let numbered = |(index, point): (usize, &&ParetoPoint)| {
        let number = (index + 1).to_string();
        let curve = Curve::dots(&format!("{number}  {}", label(point)), vec![place(point)]);
        curve.tagged(&number).coloured(COLOURS[usize::from(point.level) % COLOURS.len()])
    };
    let mut curves = vec![
        Curve::line("", vec![(1.0, least), (1.0, most)]).coloured(GREY),
        Curve::dots("", places(&dominated)).coloured(PALE),
        Curve::line("", places(&best)).coloured(GREY),
    ];
    curves.extend(best.iter().enumerate().map(numbered));
    let x = Axis::log("load: time of computing per simulated time, one thread");
    let y = Axis::log("error, %: the larger of displacement's and force's, rms");
    let title = format!("{}: error against load", pareto.notes["scene"]);
    Figure::new("pareto", &title, Chart::new(x, y, curves)).sized((1000, 700))
}

/// `profile`: the height of the top over x at the end of the reference and of the runs.
pub fn profile(scene: &str, reference: &Run, runs: &[Run]) -> Figure {
    let line = |what: &str, run: &Run| {
        let moved = |(point, u): (&super::points::Point, &[f32; 3])| {
            (1e3 * (point.position_m[0] + f64::from(u[0])), 1e3 * (point.position_m[1] + f64::from(u[1])))
        };
        let label = format!("{what}, level {}: {:.2} ms a step", run.job.setting.level, run.cost.median_ms);
        Curve::line(&label, run.job.profile.iter().zip(&run.profile_m).map(moved).collect())
    };
    let mut curves: Vec<_> = runs.iter().map(|run| line(&sweep::name_of(run.job.setting.element), run)).collect();
    curves.push(line("reference", reference).coloured(BLACK));
    let chart = Chart::new(Axis::fitted("x, mm"), Axis::fitted("height, mm"), curves);
    Figure::new("profile", &format!("{scene}: its top at the end, in the middle"), chart)
}

fn place(point: &ParetoPoint) -> (f64, f64) {
    (point.load(), (100.0 * point.error()).max(LEAST_PERCENT))
}
