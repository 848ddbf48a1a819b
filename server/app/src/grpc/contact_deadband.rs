//! Which contacts a driver can do without: those that the one before predicts as well as a hand can tell, for a tool that
//! has not left the place that its model vouches for. A tool that cuts on meets the same force, but where it turns round
//! its station has to know where it was. To a driver without models the one before says that the force stays as it is.

use kerf_physics::Vec3;
use kerf_physics::step_io::{ContactModel, ToolOutput};
use kerf_proto::v1;
use kerf_session::{StepReport, ToolReport};

use crate::status::RequestError;

/// Largest share: of more there is no contact to speak of.
const MAX_SHARE: f64 = 0.5;
/// Forces below this count as this, N.
const LEAST_FORCE_N: f64 = 1e-3;
/// Change of a model's stiffness that is told though the force is as predicted, as a share of it.
const STIFFNESS_SHARE: f64 = 0.25;

/// What was told of a driver's tools, and how well that has to predict what they feel now.
pub struct ContactDeadband {
    share: f64,
    without_models: bool,
    keep_alive_ns: u64,
    told_ns: u64,
    told: Vec<ToolReport>,
}

impl ContactDeadband {
    /// For what a client asks for; `max_age_s` is the greatest age of a contact.
    ///
    /// # Errors
    /// A number is not one.
    pub fn new(hello: &v1::ClientHello, max_age_s: f64) -> Result<Self, RequestError> {
        let (share, keep_alive_s) = (hello.contact_deadband, hello.contact_keep_alive_s);
        for (field, value) in [("hello.contact_deadband", share), ("hello.contact_keep_alive_s", keep_alive_s)] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(RequestError::Rate { field, value });
            }
        }
        let longest_s = max_age_s / 4.0;
        let keep_alive_s = if keep_alive_s == 0.0 { longest_s } else { keep_alive_s.min(longest_s) };
        Ok(Self {
            share: share.min(MAX_SHARE),
            without_models: hello.without_models,
            keep_alive_ns: (keep_alive_s * 1e9) as u64,
            told_ns: 0,
            told: Vec::new(),
        })
    }

    /// Whether a report says of these tools what a hand would notice, or has to be told to show that all is well.
    pub fn is_news(&self, report: &StepReport, tools: &[usize]) -> bool {
        self.share == 0.0
            || report.ended_ns.saturating_sub(self.told_ns) >= self.keep_alive_ns
            || self.told.len() != tools.len()
            || self
                .told
                .iter()
                .zip(tools)
                .any(|(told, &tool)| report.tools.get(tool).is_none_or(|now| !self.is_predicted(told, now)))
    }

    /// This report is told.
    pub fn tell(&mut self, report: &StepReport, tools: &[usize]) {
        self.told_ns = report.ended_ns;
        self.told.clear();
        self.told.extend(tools.iter().filter_map(|&tool| report.tools.get(tool)));
    }

    /// Whether a station knows when the cut begins as well as it knows the force.
    fn gives_alike(&self, told: &ContactModel, now: &ContactModel) -> bool {
        match (told.give, now.give) {
            (Some(told), Some(now)) => (told.at_n - now.at_n).abs() <= self.share * told.at_n,
            (told, now) => told.is_none() && now.is_none(),
        }
    }

    /// The model that a driver is told. Who drove the tool before may have asked for one that it has none of.
    fn model<'a>(&self, output: &'a ToolOutput) -> Option<&'a ContactModel> {
        output.contact.as_ref().filter(|_| !self.without_models)
    }

    fn is_predicted(&self, told: &ToolReport, now: &ToolReport) -> bool {
        let waits_alike = told.waits == now.waits;
        let (told, now) = (&told.output, &now.output);
        let (told_model, now_model) = (self.model(told), self.model(now));
        let is_alike = waits_alike
            && told.pose.is_some() == now.pose.is_some()
            && told.grasp == now.grasp
            && match (told_model, now_model) {
                (Some(told), Some(now)) => is_as_stiff(told, now) && self.gives_alike(told, now),
                (told, now) => told.is_none() && now.is_none(),
            };
        let is_valid = told_model.zip(now.pose).is_none_or(|(model, pose)| {
            (pose.position_m - model.reference.position_m).norm() <= model.validity_radius_m
        });
        let predicted_n = told_model.zip(now.pose).map_or(told.wrench.force_n, |(model, pose)| {
            let moved_m = pose.position_m - model.reference.position_m;
            force_n(model, &moved_m)
        });
        let felt_n = now.wrench.force_n;
        let may_differ_n = self.share * felt_n.norm().max(LEAST_FORCE_N);
        is_alike && is_valid && (felt_n - predicted_n).norm() <= may_differ_n
    }
}

fn is_as_stiff(told: &ContactModel, now: &ContactModel) -> bool {
    let entries = (0..3).flat_map(|i| (0..3).map(move |j| (i, j)));
    let (mut changed, mut size) = (0.0, 0.0);
    for (i, j) in entries {
        changed += (told.stiffness[i][j] - now.stiffness[i][j]).powi(2);
        size += told.stiffness[i][j].powi(2);
    }
    told.force_cap_n.is_some() == now.force_cap_n.is_some() && changed <= STIFFNESS_SHARE * STIFFNESS_SHARE * size
}

/// Force of a model for a tool that has moved, as a station renders it.
fn force_n(model: &ContactModel, moved_m: &Vec3) -> Vec3 {
    let row = |i: usize| (0..3).map(|j| model.stiffness[i][j] * moved_m[j]).sum::<f64>();
    let force_n = model.wrench.force_n - Vec3::new(row(0), row(1), row(2));
    match model.force_cap_n {
        Some(cap_n) => {
            let along_n = force_n.dot(&model.cap_direction);
            let given = model.give.filter(|give| along_n >= give.at_n);
            let cap_n = given.map_or(cap_n, |give| cap_n.min(give.cap_n));
            force_n + model.cap_direction * (along_n.clamp(0.0, cap_n) - along_n)
        }
        None => force_n,
    }
}

#[cfg(test)]
mod tests {
    use kerf_physics::Pose;
    use kerf_physics::step_io::{Give, ToolOutput, Wrench};

    use super::*;

    /// A tool that has gone `depth_m` into a floor of 500 N/m.
    fn report(at_ms: u64, depth_m: f64) -> StepReport {
        let mut stiffness = [[0.0; 6]; 6];
        stiffness[1][1] = 500.0;
        let reference = Pose { position_m: Vec3::new(0.0, -depth_m, 0.0), ..Pose::default() };
        let wrench = Wrench { force_n: Vec3::y() * (500.0 * depth_m), ..Wrench::default() };
        let contact = ContactModel {
            reference,
            wrench,
            stiffness,
            damping: [[0.0; 6]; 6],
            velocity_m_per_s: Vec3::zeros(),
            angular_velocity_rad_per_s: Vec3::zeros(),
            force_cap_n: None,
            give: None,
            cap_direction: Vec3::y(),
            validity_radius_m: 0.01,
        };
        let output = ToolOutput {
            pose: Some(reference),
            wrench,
            contact: (depth_m > 0.0).then_some(contact),
            ..ToolOutput::default()
        };
        let tools = vec![ToolReport { output, ..ToolReport::default() }];
        StepReport { ended_ns: at_ms * 1_000_000, tools, ..StepReport::default() }
    }

    fn deadband_for(hello: &v1::ClientHello) -> ContactDeadband {
        ContactDeadband::new(hello, 0.1).unwrap()
    }

    fn deadband(share: f64) -> ContactDeadband {
        deadband_for(&v1::ClientHello { contact_deadband: share, ..v1::ClientHello::default() })
    }

    #[test]
    fn what_the_last_contact_predicts_is_left_out_until_the_keep_alive() {
        let mut deadband = deadband(0.05);
        assert!(deadband.is_news(&report(0, 0.002), &[0]), "the first");
        deadband.tell(&report(0, 0.002), &[0]);
        // Twice the force, and just as the model says.
        assert!(!deadband.is_news(&report(10, 0.004), &[0]));
        assert!(deadband.is_news(&report(25, 0.002), &[0]), "a quarter of 0.1 s");
        // Just as the model says, but 11 mm away from where it was made.
        assert!(deadband.is_news(&report(10, 0.013), &[0]), "its radius is 10 mm");
    }

    #[test]
    fn what_it_does_not_predict_is_told() {
        let mut deadband = deadband(0.05);
        deadband.tell(&report(0, 0.002), &[0]);
        let changes: [fn(&mut ToolOutput); 5] = [
            |output| output.wrench.force_n.y *= 1.1,
            |output| output.pose = None,
            |output| output.contact = None,
            |output| output.contact.as_mut().unwrap().stiffness[1][1] = 700.0,
            |output| output.contact.as_mut().unwrap().force_cap_n = Some(9.0),
        ];
        for change in changes {
            let mut now = report(4, 0.002);
            assert!(!deadband.is_news(&now, &[0]));
            change(&mut now.tools[0].output);
            assert!(deadband.is_news(&now, &[0]));
        }
        let mut waiting = report(4, 0.002);
        waiting.tools[0].waits = true;
        assert!(deadband.is_news(&waiting, &[0]));
    }

    #[test]
    fn a_cut_that_began_or_did_not_where_the_station_felt_it_begin_is_told() {
        let cutting = |at_ms, depth_m, at_n: Option<f64>| {
            let mut report = report(at_ms, depth_m);
            let model = report.tools[0].output.contact.as_mut().unwrap();
            (model.force_cap_n, model.give) = (Some(2.0), at_n.map(|at_n| Give { at_n, cap_n: 1.0 }));
            report
        };
        let mut deadband = deadband(0.05);
        deadband.tell(&cutting(0, 0.002, Some(1.8)), &[0]);
        assert!(!deadband.is_news(&cutting(4, 0.0034, Some(1.8)), &[0]));
        assert!(deadband.is_news(&cutting(4, 0.0038, Some(1.8)), &[0]), "the station renders 1 N there");
        assert!(deadband.is_news(&cutting(4, 0.002, Some(1.6)), &[0]), "it begins at another force");
        assert!(deadband.is_news(&cutting(4, 0.002, None), &[0]), "it has begun");
    }

    #[test]
    fn without_a_share_everything_is_told_and_numbers_that_are_none_are_refused() {
        let mut all = deadband(0.0);
        all.tell(&report(0, 0.002), &[0]);
        assert!(all.is_news(&report(1, 0.002), &[0]));
        for (contact_deadband, contact_keep_alive_s) in [(f64::NAN, 0.0), (0.1, -1.0)] {
            let hello = v1::ClientHello { contact_deadband, contact_keep_alive_s, ..v1::ClientHello::default() };
            assert!(ContactDeadband::new(&hello, 0.1).is_err());
        }
    }

    #[test]
    fn without_models_a_contact_is_left_out_while_the_force_stays_as_it_is() {
        let hello = v1::ClientHello { contact_deadband: 0.05, without_models: true, ..v1::ClientHello::default() };
        let mut deadband = deadband_for(&hello);
        deadband.tell(&report(0, 0.002), &[0]);
        let left_by_another_driver = report(10, 0.004);
        assert!(deadband.is_news(&left_by_another_driver, &[0]), "the force is as its model says, which was not told");
        let moved = |depth_m| {
            let mut report = report(10, depth_m);
            let output = &mut report.tools[0].output;
            output.contact = None;
            output.pose.as_mut().unwrap().position_m.x = 0.1;
            report
        };
        assert!(!deadband.is_news(&moved(0.00208), &[0]), "4 % more");
        assert!(deadband.is_news(&moved(0.0022), &[0]), "10 % more");
    }
}
