//! The page that says what the figures show, written from their files alone.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;

use anyhow::Result;
use kerf_plot::{Axis, Chart, Curve, Figure as Plot};

use super::tables::{Compared, Figure, Verdict, file_name, read};
use crate::rows::read_commit;

/// A family as the page speaks of it.
struct Chapter {
    /// Its title.
    title: &'static str,
    /// What its figures are compared with.
    against: &'static str,
    /// What is known of why figures miss their limit; empty where none does, or the cause is not known.
    cause: &'static str,
}

const fn chapter(title: &'static str, against: &'static str) -> Chapter {
    Chapter { title, against, cause: "" }
}

const STEADY: &str = "Steady cuts";

const CHAPTERS: [Chapter; 17] = [
    chapter(
        "Elements: patch test, rotation, gradient",
        "exact: constant stress, no force from rotation, force = -dU/dx",
    ),
    chapter("Uniaxial stress", "Hooke's law"),
    chapter("Bending of composite elements", "full FEM, extrapolated (Richardson)"),
    chapter("Cantilever under its own weight", "Timoshenko's beam, the elastica, Reissner's beam, first frequency"),
    Chapter {
        title: "Thin clamps",
        against: "full FEM, extrapolated (Richardson)",
        cause: "The clamp is one voxel thick there, the element eight.",
    },
    Chapter {
        title: "Sides off the lattice",
        against: "density times volume, Timoshenko's beam",
        cause: "A partly filled voxel counts in its middle, so the outer layers stand too far out. Beam theory with that \
                second moment of area predicts 13.0 % for this bar; the rest is the composite element's. The error falls \
                with the square of the voxels across the bar.",
    },
    chapter("Large deflection under a tip load", "Mattiasson's elastica, Reissner's beam"),
    chapter("Pressure on a half-space", "Love's and Flamant's solutions"),
    Chapter {
        title: "A probe on a half-space",
        against: "Hertz's contact, corrected for the block",
        cause: "The contact is 2.2 voxels in radius, about a quarter of a level 3 element.",
    },
    chapter("Energy release without a blade", "Rivlin and Thomas's strip, Foote and Buchwald's cantilever"),
    chapter("Speed of a tear", "the Rayleigh wave's speed"),
    Chapter {
        title: "Motion without input",
        against: "conserved momenta, energy that does not rise, return to rest",
        cause: "Nodes start at random places in a material that stiffens strongly (c = 10). They have not come back \
                after 1500 steps at k = 1 and 2.",
    },
    chapter("Centrifugal strain", "a spinning rod of linear Biot stress"),
    chapter(STEADY, "Griffith's balance: -dPi/dA = Gc, F = Gc w, W = Gc A"),
    chapter("Cuts: width, slicing, speed, regions", "Gc w, slice-push ratios of Atkins, Xu and Jeronimidis"),
    chapter("Scissors", "the section's area, Gc times it"),
    chapter("Two fracture rules", "Griffith's balance; the rule of He et al. beside it"),
];

/// Share of its limit from which a figure that is met counts as close to it.
const CLOSE: f64 = 0.9;

/// The files of all families.
pub struct Tables {
    families: Vec<(&'static Chapter, Vec<Figure>)>,
    commit: String,
}

impl Tables {
    /// Reads them from `folder`.
    ///
    /// # Errors
    /// One is absent or no such file.
    pub fn read(folder: &Path) -> Result<Self> {
        let family = |chapter: &'static Chapter| Ok((chapter, read(folder, chapter.title)?));
        Ok(Self { families: CHAPTERS.iter().map(family).collect::<Result<_>>()?, commit: read_commit(folder)? })
    }

    /// The page; the tables' folder is `../reference/verification/` from it.
    #[must_use]
    pub fn page(&self) -> String {
        let all = || self.families.iter().flat_map(|(_, figures)| figures);
        let limited = all().filter(|figure| figure.verdict != Verdict::NoLimit).count();
        let met = all().filter(|figure| figure.verdict == Verdict::Met).count();
        let mut text = format!(
            "# Verification\n\n\
             Kerf is compared with analytic solutions and with converged finite elements. {met} of the {limited} figures \
             that have a limit keep it. The {missed} others are listed [below](#limits-that-are-missed), with their \
             causes where these are known.\n\n\
             `make verify` runs every case, writes the [tables](../reference/verification/README.md) and this page; the \
             same code yields the same bytes. These figures are those of commit {commit}. `make verify-page` writes the \
             page from the tables. A coarse part of each family runs in `make test`. The page shows that the equations are solved, not that they \
             describe tissue; [the experiment](experiment.md) compares with a published measurement.\n\n",
            missed = limited - met,
            commit = self.commit,
        );
        self.energy(&mut text);
        self.families(&mut text);
        self.missed(&mut text);
        self.close(&mut text);
        text.push_str(SCOPE);
        text
    }

    fn steady(&self) -> &[Figure] {
        self.families.iter().find(|(chapter, _)| chapter.title == STEADY).map_or(&[], |(_, figures)| figures)
    }

    fn energy(&self, text: &mut String) {
        text.push_str(ENERGY);
        let mut materials: BTreeMap<&str, Vec<&Figure>> = BTreeMap::new();
        for figure in self.steady() {
            let material = figure.case.split([',', ':']).next().unwrap_or_default();
            materials.entry(material).or_default().push(figure);
        }
        for (material, figures) in materials {
            let of = |what: &str| Range::of(figures.iter().filter(|f| f.case.ends_with(what)).copied());
            let Some(release) = of(": -dPi/dA at constant force / Gc") else { continue };
            let cells = [Some(release), of(": -dU/dA at a held blade / Gc"), of(": F / Gc w")];
            let cells = cells.map(|cell| cell.map_or_else(String::new, |range| range.to_string()));
            let missed = figures.iter().filter(|figure| figure.verdict == Verdict::Missed);
            let missed: BTreeSet<_> = missed.filter_map(|figure| figure.case.split(": ").next()).collect();
            let missed = missed_in_bold(missed.len());
            let _ = writeln!(text, "| {material} | {}{missed} | {} |", release.count, cells.join(" | "));
        }
        text.push_str(ENERGY_READ);
    }

    fn families(&self, text: &mut String) {
        text.push_str(
            "## What is compared\n\n\
             | family | compared with | figures | limits kept | largest error |\n|---|---|---|---|---|\n",
        );
        for (Chapter { title, against, .. }, figures) in &self.families {
            let limited = figures.iter().filter(|f| f.verdict != Verdict::NoLimit).count();
            let met = figures.iter().filter(|f| f.verdict == Verdict::Met).count();
            let kept = if limited == 0 { "none set".into() } else { format!("{met} of {limited}") };
            let file = file_name(title);
            let _ = writeln!(
                text,
                "| [{title}](../reference/verification/{file}.csv) | {against} | {} | {kept} | {} |",
                figures.len(),
                largest_error(title, figures),
            );
        }
        text.push_str(FAMILIES_READ);
    }

    fn missed(&self, text: &mut String) {
        text.push_str("## Limits that are missed\n");
        for (Chapter { title, cause, .. }, figures) in &self.families {
            let missed: Vec<_> = figures.iter().filter(|f| f.verdict == Verdict::Missed).collect();
            if missed.is_empty() {
                continue;
            }
            let cause = if cause.is_empty() { "The cause is not known." } else { cause };
            let _ = writeln!(text, "\n**{title}.** {cause}\n");
            missed.iter().for_each(|figure| _ = writeln!(text, "- {}", line(figure)));
        }
    }

    fn close(&self, text: &mut String) {
        text.push_str("\n## Close to a limit\n\nThese keep their limit by less than a tenth of it.\n\n");
        for figure in self.families.iter().flat_map(|(_, figures)| figures) {
            if figure.verdict == Verdict::Met
                && !figure.error_percent.is_empty()
                && figure.of_limit().is_some_and(|s| s > CLOSE)
            {
                let _ = writeln!(text, "- {}", line(figure));
            }
        }
        text.push('\n');
    }

    /// Error over limit of every figure that has a relative one, in order of size, a curve for each family.
    #[must_use]
    pub fn margins(&self) -> Plot {
        let curve = |(chapter, figures): &(&Chapter, Vec<Figure>)| {
            let relative = figures.iter().filter(|f| !f.limit_percent.is_empty());
            let mut shares: Vec<f64> = relative.filter_map(Figure::of_limit).map(|share| share.max(1e-3)).collect();
            shares.sort_by(f64::total_cmp);
            let last = shares.len().saturating_sub(1).max(1) as f64;
            let points: Vec<_> = shares.iter().enumerate().map(|(i, s)| (100.0 * i as f64 / last, *s)).collect();
            (!points.is_empty()).then(|| Curve::dotted_line(chapter.title, points))
        };
        let mut curves: Vec<Curve> = self.families.iter().filter_map(curve).collect();
        curves.push(Curve::dashes("limit", (0.0, 1.0), (100.0, 1.0)));
        let chart =
            Chart::new(Axis::linear("share of the family's figures, %"), Axis::log("error over its limit"), curves);
        Plot::new("verification-margins", "Error over its limit, by family", chart)
    }
}

/// Least and greatest of some figures.
#[derive(Clone, Copy)]
struct Range {
    count: usize,
    least: f64,
    greatest: f64,
    missed: usize,
}

impl Range {
    fn of<'a>(figures: impl Iterator<Item = &'a Figure>) -> Option<Self> {
        figures.filter_map(|f| Some((f.measured.parse::<f64>().ok()?, f.verdict == Verdict::Missed))).fold(
            None,
            |range: Option<Self>, (value, is_missed)| {
                let range = range.unwrap_or(Self { count: 0, least: value, greatest: value, missed: 0 });
                Some(Self {
                    count: range.count + 1,
                    least: range.least.min(value),
                    greatest: range.greatest.max(value),
                    missed: range.missed + usize::from(is_missed),
                })
            },
        )
    }
}

impl std::fmt::Display for Range {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.count == 1 {
            write!(f, "{:.3}", self.least)?;
        } else {
            write!(f, "{:.3} to {:.3}", self.least, self.greatest)?;
        }
        f.write_str(&missed_in_bold(self.missed))
    }
}

fn missed_in_bold(count: usize) -> String {
    if count > 0 { format!(" (**{count} missed**)") } else { String::new() }
}

/// The largest relative error of a family, of the figures with a limit where there are such; else the largest bound of
/// what should be zero.
fn largest_error(title: &str, figures: &[Figure]) -> String {
    if title == "Two fracture rules" {
        // The other rule is not Kerf's own.
        let own: Vec<Figure> = figures.iter().filter(|f| f.case.starts_with("front")).cloned().collect();
        return largest_error("", &own);
    }
    let has_limit = figures.iter().any(|f| !f.limit_percent.is_empty());
    let shown = || figures.iter().filter(move |f| !has_limit || !f.limit_percent.is_empty());
    let largest = |of: fn(&Figure) -> &str| {
        shown()
            .filter_map(|f| of(f).parse::<f64>().ok())
            .map(f64::abs)
            .fold(None, |a: Option<f64>, b| Some(a.map_or(b, |a| a.max(b))))
    };
    match largest(|f| &f.error_percent) {
        Some(error) if error < 1e-3 => "below 0.001 %".into(),
        Some(error) => format!("{error:.1} %"),
        None if figures.iter().all(|f| f.compared == Compared::Zero) => {
            largest(|f| &f.measured).map_or_else(String::new, |bound| format!("below {bound:e}"))
        }
        None => "see below".into(),
    }
}

fn line(figure: &Figure) -> String {
    let Figure { case, mesh, measured, reference, error_percent, limit_percent, .. } = figure;
    let mesh = if mesh.is_empty() { String::new() } else { format!(", {mesh}") };
    if error_percent.is_empty() {
        format!("{case}{mesh}: {measured}, limit {reference}")
    } else {
        format!("{case}{mesh}: {measured} against {reference}, {error_percent} %, limit {limit_percent} %")
    }
}

const ENERGY: &str = "## The energy of a cut

A cutting simulator is correct where a cut costs the material's fracture energy. Let Pi be the potential energy of tissue and tool
force together, A the area that is cut, and Gc the fracture energy of the material. In a steady cut

```math
-\\frac{d\\Pi}{dA} = G_c
```

(Irwin and Kies 1954). The derivative is measured between states at rest, from forces, energies and areas alone. No
value inside the fracture code enters it. The force of a blade of width w is then F = Gc w. That
balance follows from how the crack front is built, so it is the weaker proof. Each limit in this table is 5 %.
A case is missed where any of its figures is.

| material | cases | -dPi/dA over Gc | -dU/dA, blade at rest, over Gc | F over Gc w |
|---|---|---|---|---|
";

const ENERGY_READ: &str = "
`liver` is the paper's, 2 MPa; its cases vary element size, voxel size, time step, cutting plane, place in the element,
contact penalty and edge width. `real liver` is 10 kPa, the value of measurements. It is the hardest case: Gc/E is 20 mm
there, so the block is small beside it and deforms as a whole.

![Force over depth in steady cuts of the paper's liver, three meshes](../reference/verification/verification-cut.png)

Force over the depth of the edge, on three meshes. It rises until the cut starts at twice Gc w (the default
`initiation_ratio`), then falls to Gc w.

";

const FAMILIES_READ: &str = "
Where a family has limits, the largest error is that of the figures with a limit. For bending, beams and half-spaces it is
that of the coarsest mesh; the tables have the mesh sequence. The half-space at one element per half-width is off by up to 27 %, at two by 1 %. The double cantilever's
largest error is against simple beam theory, which lacks the rotation of the root; against Foote and Buchwald it is 12.5 %
on the coarsest mesh of the offset crack.

![Error over its limit, by family](../reference/verification/verification-margins.png)

Every figure with a relative limit, in order of its size. A point above the dashed line misses its limit.

The last family compares Kerf's crack front with the rule of He et al. (2022), which cuts a link where its elastic energy
reaches Gc / h. On the same cut the front takes Gc w on every mesh. The other rule takes 18 to 143 times Gc w, and the factor
grows with the level. Kerf keeps that rule as `fracture_rule = \"link_energy\"` for this comparison.

";

const SCOPE: &str = "## What this does not show

- Steady cuts run at k = 2, 4 and 8, on voxels of 1 to 7 mm. Level 0 cuts in the comparison of the two rules alone.
- No figure here is a measurement of tissue: see [the experiment](experiment.md).
- The ends of the supported ranges are in [stability](stability.md), random strokes in [strokes](strokes.md).
";
