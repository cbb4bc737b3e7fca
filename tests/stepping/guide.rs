//! The Rust of the guide's pages is what runs here.

/// The lines of a text, without indents and alignment.
fn lines(text: &str) -> Vec<String> {
    text.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
}

/// The snippet of `docs/src/details.md`: its last thrust.
#[allow(unused_variables, reason = "as printed")]
fn of_details() -> caudal::Result<f64> {
    let mut last = 0.0;
    let scene = caudal::scene::Scene::load("models/driven-head.toml")?;
    let mut tail = caudal::stepper::Stepper::of(&scene)?;
    while tail.time() < 2.0 {
        tail.set("head_angle_rad", &[0.1])?; // inputs hold until they are set again
        tail.do_step(0.01)?; // any step: it is divided into internal ones
        let thrust = tail.get_scalar("head_force_x_n")?;
        let before = tail.save(); // and restore(&before) continues with identical bits
        last = thrust;
    }
    Ok(last)
}

/// What stands for the scene of the page `own-tail.md`, which a reader has saved.
const SCENE: &str = "models/silicone-tail.toml";

/// The snippet of `docs/src/hosts.md`: its last thrust.
#[allow(unused_variables, reason = "as printed")]
fn of_hosts() -> caudal::Result<f64> {
    let mut last = 0.0;
    let scene = caudal::scene::Scene::load(SCENE)?;
    let mut tail = caudal::stepper::Stepper::of(&scene)?;
    while tail.time() < 2.0 {
        tail.set("head_angle_rad", &[0.1])?; // inputs hold until they are set again
        tail.do_step(0.01)?; // any step: it is divided into internal ones
        let thrust = -tail.get_scalar("head_force_x_n")?;
        let before = tail.save(); // and restore(&before) continues equal to the bit
        last = thrust;
    }
    Ok(last)
}

#[test]
fn the_rust_of_the_guide_runs_as_printed() {
    let here = lines(include_str!("guide.rs"));
    for (page, run) in [("details", of_details as fn() -> caudal::Result<f64>), ("hosts", of_hosts)] {
        let text = std::fs::read_to_string(format!("docs/src/{page}.md")).unwrap();
        let blocks: Vec<&str> =
            text.split("```rust,ignore\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect();
        assert_eq!(blocks.len(), 1, "{page}: a function here for each");
        let mut printed = lines(&blocks[0].replace("\"silicone-tail.toml\"", "SCENE"));
        let end = printed.pop().unwrap();
        assert_eq!(end, "}");
        assert!(here.windows(printed.len()).any(|window| window == printed), "{page}: {printed:#?}");
        assert!(run().unwrap().is_finite());
    }
}
