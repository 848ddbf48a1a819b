#![allow(missing_docs)]
use kerf_physics::scene::*;
use kerf_physics::tool::Pose;
use kerf_physics::*;
use std::time::Instant;
struct C(Instant);
impl StageClock for C {
    fn now_ns(&self) -> u64 {
        self.0.elapsed().as_nanos() as u64
    }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let f = |i: usize, d: f64| a.get(i).and_then(|s| s.parse().ok()).unwrap_or(d);
    let (h, level, gc_ratio, e, c) = (f(1, 0.0025), f(2, 2.0) as u8, f(3, 0.05), f(4, 1e6), f(5, 0.0));
    let speed = f(6, 0.05);
    let gc = gc_ratio * e * 0.01; // of E H with H=1cm nominal
    let s = 0.08;
    let material = MaterialDesc {
        young_modulus_pa: e,
        poisson_ratio: 0.45,
        density_kg_per_m3: 1000.0,
        rayleigh_alpha_per_s: 0.0,
        rayleigh_beta_s: f(7, 2e-4),
        fracture_energy_j_per_m2: Some(gc),
        initiation_ratio: 2.0,
        strain_stiffening: c,
    };
    let object = ObjectDesc {
        name: "b".into(),
        shape: ShapeDesc::Box { min_m: [-s / 2.0, 0.0, -s / 2.0], max_m: [s / 2.0, s / 2.0, s / 2.0] },
        voxel_size_m: Some(h),
        resolution: None,
        level,
        material,
        regions: vec![],
        fixed: vec![ShapeDesc::Box { min_m: [-1.0, -1.0, -1.0], max_m: [1.0, h * 1.01, 1.0] }],
        loads: vec![],
    };
    let w = f(8, 0.12);
    let scene = Scene {
        desc: SceneDesc {
            version: 1,
            name: "t".into(),
            description: String::new(),
            rate_hz: 1000.0,
            gravity_m_per_s2: [0.0; 3],
            solver: SolverDesc { relative_tolerance: 1e-3, max_iterations: 200 },
            objects: vec![object],
            tools: vec![ToolDesc {
                name: "k".into(),
                blade: BladeDesc { width_m: w, height_m: 0.05, edge_half_width_m: 5e-5, thickness_m: 0.0 },
            }],
            probes: vec![],
        },
        meshes: Default::default(),
    };
    let mut world = World::new(&scene).unwrap();
    println!("{:?} gc {gc}", world.counts());
    let clock = C(Instant::now());
    let (mut work, mut area, mut res, mut tool) = (0.0, 0.0, 0.0f64, 0.0);
    let mut sums = [0.0; 8];
    let top = s / 2.0 + 0.002;
    let zoff = f(9, 0.0004);
    let yaw = f(10, 0.0);
    let steps = (0.036 / speed * 1000.0) as usize;
    let mut prev = 0.0;
    let mut prof: Vec<StepProfile> = vec![];
    let mut frac = vec![];
    let mut it = 0;
    let mut solves = 0;
    for i in 0..steps {
        let y = top - speed * 0.001 * i as f64;
        let q = Quat::from_axis_angle(&nalgebra::Vector3::y_axis(), yaw.to_radians());
        let pose = Pose { position_m: Vec3::new(0.0, y, zoff), orientation: q };
        let inp = [ToolInput { tool: 0, motion: step_io::ToolMotion::MoveTo(pose) }];
        let o = world.step(&Workers::serial(), &clock, &StepInputs { tools: &inp });
        let wr = o.tools[0].wrench;
        let en = o.energy;
        area += o.fracture.cut_area_m2;
        work += en.fracture_j + en.front_slip_j;
        res += en.residual_j;
        tool += en.tool_work_j;
        for (s, v) in sums.iter_mut().zip([
            en.fracture_j,
            en.front_slip_j,
            en.initiation_j,
            en.damping_j,
            en.parting_j,
            en.numerical_j,
            en.elastic_j - prev,
            0.0,
        ]) {
            *s += v;
        }
        prev = en.elastic_j;
        it += o.solve.iterations;
        solves += o.solve.solves;
        if o.fracture.parted_links > 0 {
            frac.push(o.profile)
        } else {
            prof.push(o.profile)
        }
        if i % (steps / 40) == 0 || o.fault.is_some() {
            println!(
                "t {:.3} y {:+.4} Fy {:8.3} N Fx {:+.3} Fz {:+.3} F/(Gc w) {:.3} area {:.3e} parted {} el {:.2e} kin {:.1e} c {:.1e} it {} {:?}",
                o.sim_time_s,
                y - s / 2.0,
                wr.force_n.y,
                wr.force_n.x,
                wr.force_n.z,
                wr.force_n.y / (gc * w.min(s)),
                area,
                o.fracture.parted_links,
                en.elastic_j,
                en.kinetic_j,
                en.contact_j,
                o.solve.iterations,
                o.fault
            );
        }
    }
    println!(
        "work/(Gc A) {:.3} area/(w depth) {:.3} tool {tool:.4e} residual {res:.2e} [frac slip init damp part num dEl] {sums:?} parts {}",
        work / (gc * area),
        area / (w.min(s) * 0.034),
        world.counts().parts
    );
    println!("iterations/step {:.2} solves/step {:.2}", it as f64 / steps as f64, solves as f64 / steps as f64);
    for (name, v) in [("free", &prof), ("fracture", &frac)] {
        if v.is_empty() {
            continue;
        }
        let mut t: Vec<u64> = v.iter().map(|p| p.total_ns()).collect();
        t.sort();
        print!(
            "{name}: {} steps median {:.3} ms p99 {:.3};",
            v.len(),
            t[t.len() / 2] as f64 / 1e6,
            t[t.len() * 99 / 100] as f64 / 1e6
        );
        for st in Stage::ALL {
            let mut t: Vec<u64> = v.iter().filter_map(|p| p.stage_ns[st as usize]).collect();
            t.sort();
            if !t.is_empty() {
                print!(" {} {:.0}us", st.name(), t[t.len() / 2] as f64 / 1e3);
            }
        }
        println!();
    }
}
