//! The commands that work on files, run as a user runs them.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};

use chladni::cloud::PointCloud;
use chladni::cloud::reader::{Format, ReadOptions, read};
use chladni::cloud::writer::write;
use rstest::rstest;
use tempfile::{TempDir, tempdir};

fn chladni(folder: &TempDir, arguments: &str) -> Output {
    command(folder, arguments).output().unwrap()
}

fn command(folder: &TempDir, arguments: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_chladni"));
    command.current_dir(folder.path()).args(arguments.split_whitespace());
    command
}

fn succeeded(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// The one line of an error, and its exit code.
fn failed(output: &Output) -> (i32, String) {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    let errors: Vec<&str> = text.lines().filter(|line| line.contains("error")).collect();
    assert_eq!(errors.len(), 1, "{text}");
    assert!(!text.contains("panicked") && !text.contains("backtrace"), "{text}");
    (output.status.code().unwrap(), errors[0].to_owned())
}

fn cloud(path: &Path) -> PointCloud {
    let format = Format::from_extension(path.extension().unwrap().to_str().unwrap()).unwrap();
    read(&fs::read(path).unwrap(), format, &ReadOptions::default()).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[rstest]
fn a_sample_is_written_in_the_format_of_its_extension(
    #[values("ply", "obj", "off", "xyz", "csv", "npy", "las", "laz")] extension: &str,
) {
    let folder = tempdir().unwrap();
    let told =
        succeeded(&chladni(&folder, &format!("sample torus --points 500 --sampling iid -o a.{extension}")));
    assert!(told.contains("500 points of torus"), "{told}");
    let cloud = cloud(&folder.path().join(format!("a.{extension}")));
    assert_eq!((cloud.len(), cloud.dimension()), (500, 3));
    assert_eq!(names(folder.path()).len(), 1);
}

#[test]
fn a_flat_torus_keeps_its_dimension_in_ply() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample flat-torus-6 --points 100 -o a.ply"));
    assert_eq!(cloud(&folder.path().join("a.ply")).dimension(), 6);
}

#[test]
fn the_same_seed_gives_the_same_file() {
    let folder = tempdir().unwrap();
    for (seed, file) in [(1, "a"), (1, "b"), (2, "c")] {
        succeeded(&chladni(
            &folder,
            &format!("sample sphere -n 50 --sampling nonuniform --noise 0.1 --seed {seed} -o {file}.xyz"),
        ));
    }
    let bytes = |file: &str| fs::read(folder.path().join(file)).unwrap();
    assert_eq!(bytes("a.xyz"), bytes("b.xyz"));
    assert_ne!(bytes("a.xyz"), bytes("c.xyz"));
}

#[rstest]
#[case("sample klein-bottle -o a.ply", "klein-bottle")]
#[case("sample sphere -o a.stl", "`--sampling grid` makes them")]
#[case("sample sphere -o a.e57", "the extension chooses the format; ply, ")]
#[case("sample sphere -n 0 -o a.ply", "points=0: 1 to 10000000 are possible")]
#[case("sample sphere --angle 30 -o a.ply", "angle=30")]
#[case("sample sphere --noise -1 -o a.ply", "noise=-1")]
#[case("sample flat-torus-4 -o a.off", "flat-torus-4 has 4")]
#[case("analyze missing.ply -o out", "missing.ply")]
#[case("analyze bad.xyz -o out", "bad.xyz: XYZ, line 2: `two` is not a number")]
#[case("analyze bad.bin -o out", "unknown format; name it with --format")]
#[case("analyze three.xyz -o out", "")]
#[case("analyze line.xyz -k 2 -o out", "")]
#[case("analyze good.xyz -k 0 -o out", "bases")]
#[case("analyze good.xyz --t 1 --t-factor 1 -o out", "t_factor")]
#[case("analyze good.xyz --threads 99999999 -o out", "expected a whole number from 0 to 1024")]
#[case("serve --threads 99999999", "expected a whole number from 0 to 1024")]
#[case("serve --stored-bytes-max-per-key 1X", "not a size")]
#[case("sample sphere -o no/folder/x.ply", "no/folder/x.ply: there is no folder no/folder")]
#[case("view missing.ply --listen nowhere", "not an address")]
#[case("health ftp://x", "http://HOST:PORT/livez is one")]
fn what_the_caller_can_mend_is_told_in_one_line_with_exit_code_2(
    #[case] arguments: &str,
    #[case] told: &str,
) {
    let folder = tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    write("bad.xyz", b"1 2 3\n1 two 3\n");
    write("bad.bin", b"\x00\x01\x02");
    write("three.xyz", b"0 0 0\n1 0 0\n0 1 0\n");
    let rows = |row: fn(i32) -> String| (0..50).map(row).collect::<Vec<_>>().join("\n");
    write("line.xyz", rows(|i| format!("{i} 0 0")).as_bytes());
    write("good.xyz", rows(|i| format!("{} {} 0", i % 7, i / 7)).as_bytes());
    let before = names(folder.path());
    let (code, line) = failed(&chladni(&folder, arguments));
    assert_eq!(code, 2, "{line}");
    assert!(line.contains(told), "{line}");
    assert_eq!(names(folder.path()), before, "nothing is left behind");
}

#[test]
fn an_analysis_writes_what_it_found() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample sphere --points 2000 -o sphere.ply"));
    let output = chladni(&folder, "analyze sphere.ply -o out -k 9 --threads 1");
    let told = succeeded(&output);
    assert!(told.contains("eigenvalues (9)") && told.contains("bases.npy"), "{told}");
    let progress = String::from_utf8(output.stderr).unwrap();
    assert!(progress.lines().any(|line| line == "eigenpairs"), "a line per phase: {progress}");

    let out = folder.path().join("out");
    assert_eq!(names(&out), ["bases.npy", "bases.ply", "mass.npy", "report.json", "spectrum.json"]);
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&fs::read(out.join(name)).unwrap()).unwrap()
    };
    assert_eq!(json("report.json")["rows"], 2000);
    // The sphere's eigenvalues are l(l+1), 2l+1 times each.
    let eigenvalues: Vec<f64> = json("spectrum.json")["eigenvalues"]
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    for (found, exact) in eigenvalues.iter().zip([0.0, 2.0, 2.0, 2.0, 6.0, 6.0, 6.0, 6.0, 6.0]) {
        assert!((found - exact).abs() <= 0.03 * exact + 1e-6, "{eigenvalues:?}");
    }

    let npy = |name: &str| npyz::NpyFile::new(fs::File::open(out.join(name)).unwrap()).unwrap();
    let bases = npy("bases.npy");
    assert_eq!(bases.shape(), [2000, 9]);
    let bases: Vec<f64> = bases.into_vec().unwrap();
    let mass: Vec<f64> = npy("mass.npy").into_vec().unwrap();
    assert!((mass.iter().sum::<f64>() / (4.0 * std::f64::consts::PI) - 1.0).abs() < 0.02);
    for (i, first) in bases.chunks(2000).enumerate() {
        for (j, second) in bases.chunks(2000).enumerate() {
            let product: f64 = first.iter().zip(second).zip(&mass).map(|((x, y), m)| x * y * m).sum();
            assert!((product - f64::from(u8::from(i == j))).abs() < 1e-6, "{i}, {j}: {product}");
        }
    }
    let ply = cloud(&out.join("bases.ply"));
    assert_eq!(ply.fields().len(), 9);
    assert!((ply.fields()[3].values[17] - bases[3 * 2000 + 17]).abs() < 1e-6);
}

/// 60,000 points, thinned out to 8,571 of them, take 139 MB, and 125 with their bases in a file.
#[test]
fn with_little_memory_the_same_bases_come_from_a_file() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample bumpy-sphere --points 60000 -o bumps.npy"));
    for arguments in ["-o short --memory 130MB", "-o thinned --memory 1GB --solved-points 8571"] {
        succeeded(&chladni(&folder, &format!("analyze bumps.npy --operator voronoi --quiet {arguments}")));
    }
    let of = |place: &str, name: &str| fs::read(folder.path().join(place).join(name)).unwrap();
    let names = names(&folder.path().join("short"));
    assert_eq!(names, ["bases.npy", "bases.ply", "mass.npy", "report.json", "spectrum.json"]);
    for name in names {
        assert!(of("short", &name) == of("thinned", &name), "{name}");
    }
    let spectrum: serde_json::Value = serde_json::from_slice(&of("short", "spectrum.json")).unwrap();
    assert_eq!(spectrum["method"], "prolonged");
}

#[test]
fn an_operator_is_written_as_a_sparse_matrix_with_zero_row_sums() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample torus --points 1000 -o torus.npy"));
    succeeded(&chladni(&folder, "analyze torus.npy --kind operator -o out --threads 1"));
    assert_eq!(names(&folder.path().join("out")), ["mass.npy", "operator.mtx", "report.json"]);
    let text = fs::read_to_string(folder.path().join("out/operator.mtx")).unwrap();
    assert!(text.starts_with("%%MatrixMarket matrix coordinate real symmetric\n"));
    let mut lines = text.lines().filter(|line| !line.starts_with('%'));
    let size: Vec<usize> = lines.next().unwrap().split(' ').map(|x| x.parse().unwrap()).collect();
    let mut sums = vec![(0.0, 0.0); size[0]];
    let mut add =
        |row: usize, value: f64| sums[row - 1] = (sums[row - 1].0 + value, sums[row - 1].1 + value.abs());
    let mut count = 0;
    for line in lines {
        let mut words = line.split(' ');
        let [row, column] = [(); 2].map(|()| words.next().unwrap().parse().unwrap());
        let value = words.next().unwrap().parse().unwrap();
        add(row, value);
        if row != column {
            add(column, value);
        }
        count += 1;
    }
    assert_eq!([size[0], size[1], size[2]], [1000, 1000, count]);
    assert!(sums.iter().all(|(sum, size)| *size > 0.0 && sum.abs() < 1e-9 * size));
}

#[test]
fn a_directory_that_is_not_empty_is_overwritten_only_by_force() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample sphere --points 500 -o a.xyz"));
    fs::create_dir(folder.path().join("out")).unwrap();
    fs::write(folder.path().join("out/notes.txt"), "mine").unwrap();
    let (code, line) = failed(&chladni(&folder, "analyze a.xyz -k 3 -o out"));
    assert_eq!(code, 2);
    assert!(line.contains("out is not empty; --force"), "{line}");
    succeeded(&chladni(&folder, "analyze a.xyz -k 3 -o out --force"));
    let written = names(&folder.path().join("out"));
    assert!(
        written.contains(&"notes.txt".to_owned()) && written.contains(&"bases.npy".to_owned()),
        "{written:?}"
    );
    assert_eq!(names(folder.path()), ["a.xyz", "out"]);
}

#[cfg(unix)]
#[rstest]
fn a_signal_cancels_leaves_nothing_behind_and_is_what_the_process_dies_of(
    #[values(("INT", 2), ("TERM", 15), ("HUP", 1))] (signal, number): (&str, i32),
) {
    use std::os::unix::process::ExitStatusExt;
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample sphere --points 60000 -o a.ply"));
    // A shell starts what it runs in the background with SIGINT ignored, and chladni leaves ignored signals alone.
    let mut child = Command::new("env")
        .args(["--default-signal", env!("CARGO_BIN_EXE_chladni")])
        .args(["analyze", "a.ply", "-k", "100", "-o", "out"])
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line == "neighborhoods"));
    assert!(Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap().success());
    let rest: Vec<String> = lines.collect();
    assert_eq!(child.wait().unwrap().signal(), Some(number), "shells stop a loop then");
    assert_eq!(rest.last().map(String::as_str), Some("chladni: error: canceled"), "{rest:?}");
    assert_eq!(names(folder.path()), ["a.ply"]);
}

#[test]
fn a_directory_of_results_is_filtered_transformed_and_measured() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample sphere --points 1500 --noise 0.02 -o sphere.ply"));
    succeeded(&chladni(&folder, "analyze sphere.ply -o out -k 60 --threads 1"));
    let radius_error = |name: &str| {
        let cloud = cloud(&folder.path().join(name));
        let squares = (0..cloud.len()).map(|i| {
            let radius = cloud.point(i).iter().map(|x| x * x).sum::<f64>().sqrt();
            (radius - 1.0).powi(2)
        });
        (squares.sum::<f64>() / cloud.len() as f64).sqrt()
    };
    let told = succeeded(&chladni(&folder, "filter out --filter low-pass --cutoff 9 -o smooth.ply"));
    assert!(told.contains("low-pass, cutoff 9"), "{told}");
    assert!(radius_error("smooth.ply") < 0.5 * radius_error("sphere.ply"));
    succeeded(&chladni(&folder, "filter out --gains 1,1,1,1,1,1,1,1,1 -o gains.ply"));
    assert_eq!(cloud(&folder.path().join("gains.ply")), cloud(&folder.path().join("smooth.ply")));

    let collapsed = chladni(&folder, "filter out --cutoff 1 -o one.ply --quiet");
    succeeded(&collapsed);
    assert!(String::from_utf8_lossy(&collapsed.stderr).contains("leaves the points at one place"));

    let json = |output: &Output| -> serde_json::Value { serde_json::from_str(&succeeded(output)).unwrap() };
    let coefficients = json(&chladni(&folder, "coefficients out --bands 4"));
    assert_eq!(coefficients["fields"]["z"].as_array().unwrap().len(), 60);
    assert_eq!(coefficients["energy"]["z"]["bands"].as_array().unwrap().len(), 4);
    succeeded(&chladni(&folder, "coefficients out -o c.json"));
    succeeded(&chladni(&folder, "synthesis out c.json -o back.npy"));
    assert!(radius_error("back.npy") < radius_error("sphere.ply"));

    assert!(!json(&chladni(&folder, "features out --limit 3"))["features"].as_array().unwrap().is_empty());
    assert_eq!(json(&chladni(&folder, "similarity out out"))["distance"], 0.0);
    assert_eq!(json(&chladni(&folder, "invariants out"))["is_open"], false);
    let told = succeeded(&chladni(&folder, "coefficients out --functions back.npy -o c.npy"));
    assert!(told.contains("3 functions in 60 bases"), "{told}");
    succeeded(&chladni(&folder, "signatures out --kind wks --count 5 -o wks.ply"));
    assert_eq!(cloud(&folder.path().join("wks.ply")).fields()[4].name, "wks_4");
    succeeded(&chladni(&folder, "distances out --from 3 -o d.npy"));
    let distances: Vec<f64> =
        npyz::NpyFile::new(fs::File::open(folder.path().join("d.npy")).unwrap()).unwrap().into_vec().unwrap();
    assert!(distances.len() == 1500 && distances[3] == 0.0 && distances[4] > 0.0);
}

/// A LAS file as another program writes it, with its coordinate system.
fn survey() -> Vec<u8> {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(6).unwrap();
    let transform = |offset: f64| las::Transform { scale: 0.001, offset };
    builder.transforms = las::Vector { x: transform(5e5), y: transform(5.2e6), z: transform(0.0) };
    builder.has_wkt_crs = true;
    builder.vlrs.push(las::Vlr {
        user_id: "LASF_Projection".to_owned(),
        record_id: 2112,
        description: "WKT".to_owned(),
        data: b"PROJCS[\"ETRS89 / UTM zone 32N\"]\0".to_vec(),
    });
    let mut writer =
        las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    for i in 0..400 {
        let (x, y) = (f64::from(i % 20), f64::from(i / 20));
        let point = las::Point {
            x: 5e5 + x,
            y: 5.2e6 + y,
            z: ((x + y) * 0.3).sin(),
            intensity: 7 * i as u16,
            is_withheld: i % 3 == 0,
            is_edge_of_flight_line: i % 5 == 0,
            gps_time: Some(f64::from(i)),
            ..las::Point::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.into_inner().unwrap().into_inner()
}

#[test]
fn a_filtered_survey_leaves_with_the_records_and_flags_it_came_with() {
    let folder = tempdir().unwrap();
    fs::write(folder.path().join("a.las"), survey()).unwrap();
    let mut before = Vec::new();
    write(&cloud(&folder.path().join("a.las")), Format::Las, &mut before).unwrap();
    succeeded(&chladni(&folder, "analyze a.las -o r -k 10 --operator voronoi"));
    for target in ["", "--field intensity"] {
        succeeded(&chladni(&folder, &format!("filter r -o same.las --gains 1 --outside 1 {target}")));
        let same = fs::read(folder.path().join("same.las")).unwrap();
        assert!(same == before, "a filter that changes nothing changes no byte {target}");
        succeeded(&chladni(&folder, &format!("filter r -o b.laz --filter low-pass --cutoff 5 {target}")));
        let after = cloud(&folder.path().join("b.laz"));
        let records = &after.origin().survey.as_ref().unwrap().records;
        assert!(records.iter().any(|record| record.0.windows(6).any(|text| text == b"PROJCS")), "{target}");
        let withheld = after.fields().iter().find(|field| field.name == "withheld").unwrap();
        assert_eq!(withheld.values[..4], [1.0, 0.0, 0.0, 1.0]);
    }
}

#[test]
fn pictures_are_drawn_of_clouds_bases_fields_and_feature_points_and_spectra_are_plotted() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample two-hole-torus --points 600 -o torus.ply"));
    succeeded(&chladni(&folder, "analyze torus.ply -o out -k 30 --threads 1"));
    succeeded(&chladni(&folder, "signatures out --count 1 -o hks.ply"));
    let png = |arguments: &str| {
        let told =
            succeeded(&chladni(&folder, &format!("render {arguments} --width 120 --height 90 -o a.png")));
        assert!(told.contains("120 × 90 pixels, 600 points"), "{told}");
        let bytes = fs::read(folder.path().join("a.png")).unwrap();
        assert!(bytes.starts_with(b"\x89PNG\r\n\x1a\n"));
        bytes
    };
    let pictures = [
        png("torus.ply"),
        png("torus.ply --up y --azimuth 10 --elevation -5 --background black"),
        png("out --basis 3"),
        png("out --basis 3 --features 50"),
        png("hks.ply --field hks_0"),
    ];
    for (i, picture) in pictures.iter().enumerate() {
        assert!(pictures[..i].iter().all(|other| other != picture), "picture {i} is like one before");
    }
    succeeded(&chladni(&folder, "render out -o spectrum.svg"));
    let svg = fs::read_to_string(folder.path().join("spectrum.svg")).unwrap();
    assert_eq!(svg.matches("<circle").count(), 30);
}

#[test]
fn a_completion_script_names_every_command() {
    let folder = tempdir().unwrap();
    let help = succeeded(&chladni(&folder, "--help"));
    assert!(help.contains("Exit codes:") && help.contains("`chladni serve` starts the service"));
    let commands =
        help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let commands: Vec<&str> = commands.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(commands.contains(&"serve") && commands.contains(&"render"), "{commands:?}");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = succeeded(&chladni(&folder, &format!("completions {shell}")));
        assert!(commands.iter().all(|command| script.contains(command)), "{shell}");
    }
}

#[test]
fn every_command_and_every_flag_is_explained() {
    let folder = tempdir().unwrap();
    let help = succeeded(&chladni(&folder, "--help"));
    let commands =
        help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    for command in
        commands.filter_map(|line| line.split_whitespace().next()).filter(|command| *command != "help")
    {
        let help = succeeded(&chladni(&folder, &format!("{command} --help")));
        assert!(
            help.lines().next().is_some_and(|line| !line.is_empty() && !line.starts_with("Usage")),
            "{command}"
        );
        let lines: Vec<&str> = help.lines().map(str::trim).collect();
        // "- word: …" is a value of the flag above, explained beside it
        let is_flag = |line: &str| line.starts_with('-') && !line.starts_with("- ");
        for (at, line) in lines.iter().enumerate().filter(|(_, line)| is_flag(line)) {
            let beside = line.split_once("  ").is_some_and(|(_, text)| !text.trim().is_empty());
            let below = lines.get(at + 1).is_some_and(|next| !next.is_empty() && !next.starts_with('-'));
            assert!(beside || below, "{command}: {line} is not explained");
        }
    }
}

#[test]
fn the_program_by_itself_shows_its_help_and_starts_nothing() {
    let folder = tempdir().unwrap();
    let help = succeeded(&chladni(&folder, ""));
    assert!(help.contains("Usage: chladni <COMMAND>") && help.contains("analyze"), "{help}");
    assert!(names(folder.path()).is_empty());
    assert_eq!(help, succeeded(&chladni(&folder, "help --help")));
}

#[test]
fn another_seed_is_another_sample() {
    let folder = tempdir().unwrap();
    for shape in ["sphere", "torus", "square", "flat-torus-6", "two-hole-torus"] {
        let files: Vec<_> = [0, 1, 2, 1]
            .map(|seed| {
                let told = chladni(&folder, &format!("sample {shape} -n 200 --seed {seed} -o a.npy"));
                assert!(succeeded(&told).contains(&format!("seed {seed}")));
                fs::read(folder.path().join("a.npy")).unwrap()
            })
            .into();
        assert!(files[0] != files[1] && files[1] != files[2] && files[1] == files[3], "{shape}");
    }
}

#[test]
fn a_seed_that_changes_nothing_is_refused() {
    let folder = tempdir().unwrap();
    for (seed, refused) in
        [("--seed 0", true), ("--seed 3", true), ("--seed 3 --noise 0.1", false), ("", false)]
    {
        let output = chladni(&folder, &format!("sample torus -n 100 --sampling grid {seed} -o a.npy"));
        if refused {
            let (code, line) = failed(&output);
            assert!(code == 2 && line.contains("--seed changes nothing"), "{line}");
        } else {
            succeeded(&output);
        }
    }
}

/// The output of a command that is given `input`.
fn fed(folder: &TempDir, arguments: &str, input: Vec<u8>) -> Output {
    let mut child = command(folder, arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || std::io::Write::write_all(&mut stdin, &input));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap().unwrap();
    output
}

#[test]
fn commands_read_standard_input_and_write_standard_output() {
    let folder = tempdir().unwrap();
    let sample = chladni(&folder, "sample sphere -n 400 --seed 3 -o - --output-format npy");
    assert!(sample.status.success() && sample.stdout.starts_with(b"\x93NUMPY"));
    assert!(String::from_utf8_lossy(&sample.stderr).contains("standard output: 400 points"));
    succeeded(&fed(&folder, "analyze - -k 8 --threads 1 -o out", sample.stdout));
    let ply = chladni(&folder, "filter out --cutoff 4 -o - --output-format ply --quiet");
    assert!(ply.status.success() && ply.stdout.starts_with(b"ply\n") && ply.stderr.is_empty());
    assert_eq!(read(&ply.stdout, Format::Ply, &ReadOptions::default()).unwrap().len(), 400);
    let coefficients = succeeded(&chladni(&folder, "coefficients out"));
    succeeded(&fed(
        &folder,
        "synthesis out - -o back.npy",
        succeeded_bytes("coefficients out -o - --output-format npy", &folder),
    ));
    assert!(serde_json::from_str::<serde_json::Value>(&coefficients).unwrap()["fields"]["z"].is_array());
    for (arguments, begins) in [
        ("signatures out -o -", "{\"kind\":\"hks\""),
        ("features out", "{\"points\":400"),
        ("render out -o - --output-format svg", "<svg"),
    ] {
        assert!(succeeded(&chladni(&folder, arguments)).starts_with(begins), "{arguments}");
    }
    let empty = fed(&folder, "analyze - -o none", Vec::new());
    assert!(failed(&empty).1.contains("standard input"), "{empty:?}");
}

fn succeeded_bytes(arguments: &str, folder: &TempDir) -> Vec<u8> {
    let output = chladni(folder, arguments);
    assert!(output.status.success(), "{output:?}");
    output.stdout
}

#[test]
fn what_was_done_is_told_as_json_or_not_at_all() {
    let folder = tempdir().unwrap();
    let json = |arguments: &str| -> serde_json::Value {
        serde_json::from_str(&succeeded(&chladni(&folder, arguments))).unwrap()
    };
    let told = json("sample sphere -n 400 -o a.npy --json");
    assert_eq!(
        (&told["file"], &told["points"], &told["shape"]),
        (&"a.npy".into(), &400.into(), &"sphere".into())
    );
    let told = json("analyze a.npy -k 6 --threads 1 -o out --json");
    assert_eq!(told["eigenvalues"].as_array().unwrap().len(), 6);
    assert!(told["seconds"]["total"].is_f64() && told["files"].as_array().unwrap().len() == 5, "{told}");
    assert_eq!(json("signatures out --count 3 -o s.npy --json")["scales"], 3);

    let quiet = chladni(&folder, "analyze a.npy -k 6 --threads 1 -o again --quiet");
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty(), "{quiet:?}");
    let quiet = chladni(&folder, "sample sphere -n 40 -o b.npy -q");
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty(), "{quiet:?}");
}

#[test]
fn a_wrong_value_is_told_with_its_flag_and_its_variable() {
    let folder = tempdir().unwrap();
    let refused = |arguments: &str, variables: &[(&str, &str)]| {
        let output = command(&folder, arguments).envs(variables.iter().copied()).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let told = refused("serve", &[("CHLADNI_JOBS_AT_ONCE", "abc")]);
    assert!(told.contains("--jobs-at-once") && told.contains("expected a whole number from 0"), "{told}");
    assert!(told.contains("comes from the environment variable CHLADNI_JOBS_AT_ONCE"), "{told}");
    let told = refused("serve --body-bytes-max 1X", &[]);
    assert!(
        told.contains("--body-bytes-max") && told.contains("not a size; 1073741824, 500MB, 8G and 1GiB are"),
        "{told}"
    );
    assert!(told.contains("CHLADNI_BODY_BYTES_MAX sets --body-bytes-max too"), "{told}");
    let told = refused("serve --listen nowhere", &[]);
    assert!(told.contains("not an address; 127.0.0.1:8080, localhost:8080 and 8080 are"), "{told}");
    let told = refused("analyze a.ply -o out --bases -3", &[]);
    assert!(
        told.contains("'-3' for '--bases <N>'") && told.contains("a whole number from 1 to 10000"),
        "{told}"
    );
    let told = refused("analyze a.ply -o out --quite", &[]);
    assert!(told.contains("--quiet") && !told.contains("as a value"), "{told}");
}

#[test]
fn former_names_of_flags_and_variables_still_set_what_they_did() {
    let folder = tempdir().unwrap();
    let former = [
        ("max-body", "body-bytes-max"),
        ("max-decoded", "decoded-bytes-max"),
        ("ratio-max", "decoded-ratio-max"),
    ];
    for (old, new) in former {
        let variable = |flag: &str| format!("CHLADNI_{}", flag.to_uppercase().replace('-', "_"));
        // A value that is refused shows what was read, and where it came from.
        let refused = |arguments: &str, variables: &[(String, &str)]| {
            let variables = variables.iter().map(|(name, value)| (name, value));
            let output = command(&folder, arguments).envs(variables).output().unwrap();
            assert_eq!(output.status.code(), Some(2), "{output:?}");
            String::from_utf8(output.stderr).unwrap()
        };
        let told = refused(&format!("serve --{old} 1X"), &[]);
        assert!(told.contains("1X") && told.contains(&format!("--{new}")), "{told}");
        let told = refused("serve", &[(variable(old), "1X")]);
        assert!(told.contains(&format!("--{new}")) && told.contains(&variable(old)), "{told}");
        let told = refused("serve", &[(variable(old), "7"), (variable(new), "1X")]);
        assert!(told.contains(&variable(new)), "the new name comes first: {told}");
        let help = succeeded(&chladni(&folder, "serve --help"));
        assert!(help.contains(&format!("--{new}")) && !help.contains(&format!("--{old} ")), "{help}");
    }
}

#[test]
fn keys_are_added_listed_rotated_and_revoked() {
    let folder = tempdir().unwrap();
    let key = succeeded(&chladni(&folder, "keys add lab"));
    let other = succeeded(&chladni(&folder, "keys rotate lab"));
    assert!(key.trim().len() == 64 && key != other);
    let listed = succeeded(&chladni(&folder, "keys list"));
    assert!(listed.lines().count() == 2 && listed.lines().all(|line| line.ends_with("  lab")), "{listed}");
    assert!(!listed.contains(key.trim()), "keys are not shown again");
    succeeded(&chladni(&folder, "keys revoke lab --older"));
    assert_eq!(fs::read_to_string(folder.path().join("keys")).unwrap(), format!("lab {other}"));
    succeeded(&chladni(&folder, "keys rename lab laboratory"));
    let file = fs::read_to_string(folder.path().join("keys")).unwrap();
    assert_eq!(file, format!("laboratory {other}laboratory was lab\n"));
    succeeded(&chladni(&folder, "keys rename laboratory lab"));
    for (arguments, told) in [
        ("keys add lab", "chladni keys rotate lab"),
        ("keys rename nobody somebody", "no key of `nobody`"),
        ("keys rename lab lab", "choose another name"),
        ("keys rotate nobody", "no key of `nobody`"),
        ("keys revoke lab", "the last keys"),
        ("keys list --api-keys missing/keys", ""),
    ] {
        let output = chladni(&folder, arguments);
        if told.is_empty() {
            assert!(succeeded(&output).is_empty(), "a file that is not there has no keys");
        } else {
            let (code, line) = failed(&output);
            assert!(code == 2 && line.contains(told), "{line}");
        }
    }
}

#[rstest]
#[case("render out --basis 10 -o a.png", "bases 0 to 9")]
#[case("render sphere.npy --basis 1 -o a.png", "sphere.npy is a file")]
#[case("render sphere.npy --field red -o a.png", "--field red")]
#[case("render out -o a.gif", "png, svg are possible")]
#[case("render operator -o a.svg", "without a spectrum")]
#[case("filter out -o f.txt", "f.txt: the extension chooses the format; ply, npy, json")]
#[case("filter nowhere -o f.ply", "there is no directory nowhere")]
#[case(
    "filter sphere.npy -o f.ply",
    "sphere.npy is a file; expected a directory that `chladni analyze sphere.npy -o DIR` fills"
)]
#[case("render sphere.npy -o a.svg", "sphere.npy is a file; expected a directory")]
#[case("filter out -o - --output-format stl", "STL holds triangles")]
#[case("filter out --cutoff 11 -o f.ply", "from 0 to 10")]
#[case("filter out --filter heat -o f.ply", "`time` or `cutoff` is needed")]
#[case("filter out --field red -o f.ply", "no field `red`")]
#[case("filter operator -o f.ply", "operator without bases")]
#[case("features out --radius 0", "above 0")]
#[case("distances out --from 500 -o d.npy", "0 to 499")]
#[case("distances out --kind biharmonic --time 1 -o d.npy", "belongs to kind=diffusion")]
#[case("synthesis out missing.npy -o s.npy", "missing.npy")]
fn wrong_calls_on_results_are_told_in_one_line(#[case] arguments: &str, #[case] told: &str) {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample sphere --points 500 -o sphere.npy"));
    succeeded(&chladni(&folder, "analyze sphere.npy -o out -k 10 --threads 1"));
    succeeded(&chladni(&folder, "analyze sphere.npy -o operator --kind operator --threads 1"));
    let before = names(folder.path());
    let output = chladni(&folder, arguments);
    let (code, line) = failed(&output);
    assert_eq!(code, 2, "{line}");
    assert!(line.contains(told), "{line}");
    assert_eq!(names(folder.path()), before, "nothing is left behind");
}

#[test]
fn functions_are_put_through_the_operator() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample sphere --points 800 -o s.npy"));
    // the coordinates of the sphere as three functions: Δx = −2x
    let told = succeeded(&chladni(&folder, "analyze s.npy -o r --apply s.npy --t-factor 1.5"));
    assert!(told.contains("laplacian.npy"), "{told}");
    assert_eq!(names(&folder.path().join("r")), ["laplacian.npy", "mass.npy", "operator.mtx", "report.json"]);
    let array = |name: &str| {
        let bytes = fs::read(folder.path().join(name)).unwrap();
        chladni::cloud::reader::read_columns(&bytes).unwrap()
    };
    let (x, found) = (array("s.npy"), array("r/laplacian.npy"));
    assert_eq!(found.len(), 3);
    for (x, found) in x.iter().zip(&found) {
        let error: f64 = x.iter().zip(found).map(|(x, y)| (y + 2.0 * x).powi(2)).sum();
        let size: f64 = x.iter().map(|x| 4.0 * x * x).sum();
        assert!((error / size).sqrt() < 0.1, "{}", (error / size).sqrt());
    }
    let (code, line) = failed(&chladni(&folder, "analyze s.npy -o q --kind eigen --apply s.npy"));
    assert!(code == 2 && line.contains("--kind operator"), "{line}");
    succeeded(&chladni(&folder, "sample sphere --points 700 -o short.npy"));
    let (code, line) = failed(&chladni(&folder, "analyze s.npy -o q --apply short.npy"));
    assert!(code == 2 && line.contains("700 rows; the cloud has 800"), "{line}");
}

#[test]
fn a_table_of_the_papers_is_reproduced_and_reported() {
    let folder = tempdir().unwrap();
    let told = succeeded(&chladni(&folder, "reproduce mesh-table-1 -o report.md"));
    assert!(told.contains("MESH Table 1") && told.contains("| paper | ours |"), "{told}");
    let report = fs::read_to_string(folder.path().join("report.md")).unwrap();
    assert!(report.contains("0 outside"), "{report}");
    let (code, line) = failed(&chladni(&folder, "reproduce table-99"));
    assert!(code == 2 && line.contains("table-99"), "{line}");
}

#[test]
fn a_database_that_cannot_be_reached_is_told_in_one_line_without_its_password() {
    let folder = tempdir().unwrap();
    let address = "postgres://kim:s3cret@127.0.0.1:1/chladni";
    for command in ["serve --listen 0 --database", "migrate --from x.db --to"] {
        fs::write(folder.path().join("x.db"), "").unwrap();
        let output = chladni(&folder, &format!("{command} {address}"));
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{errors}");
        let last = errors.lines().last().unwrap();
        assert!(last.contains("127.0.0.1:1 cannot be reached"), "{last}");
        assert!(!errors.contains("s3cret"), "{errors}");
    }
}

#[test]
fn what_is_for_files_or_for_servers_only_says_so() {
    let folder = tempdir().unwrap();
    let server = "--database postgres://kim@127.0.0.1:1/chladni";
    let refused = |arguments: &str, code: i32, why: &str| {
        let output = chladni(&folder, arguments);
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments}: {errors}");
        assert!(errors.contains(why), "{arguments}: {errors}");
    };
    refused(&format!("backup copy.db {server}"), 2, "pg_dump");
    refused(&format!("compact {server}"), 2, "autovacuum");
    refused("serve --no-listen", 1, "--database postgres://");
    refused("serve --listen 0 --workers 0", 1, "--database postgres://");
    refused(&format!("serve --no-listen --workers 0 {server}"), 1, "nothing to do");
    refused(
        "serve --listen 0 --database postgres://host:port/x",
        1,
        "postgres://user:password@host:5432/database",
    );
    fs::write(folder.path().join("x.db"), "").unwrap();
    refused("migrate --from x.db --to y.db", 2, "is a file");
}

/// A reader that has seen enough, and a disk that is full.
#[test]
fn output_that_cannot_be_written_breaks_nothing() {
    let folder = tempdir().unwrap();
    succeeded(&chladni(&folder, "sample sphere --points 500 -o a.ply"));
    let full = || fs::File::options().write(true).open("/dev/full").unwrap();
    let to_full =
        |arguments: &str| command(&folder, arguments).stdout(full()).stderr(full()).status().unwrap();
    assert!(to_full("analyze a.ply -k 8 -o out").success(), "what it says of its work is not its result");
    assert!(names(&folder.path().join("out")).contains(&"bases.npy".to_owned()));
    let (code, line) = failed(&command(&folder, "keys add lab").stdout(full()).output().unwrap());
    assert_eq!((code, line.contains("standard output")), (1, true), "{line}");
    assert!(!folder.path().join("keys").exists(), "a key that nobody has seen is valid");
    for arguments in ["completions bash", "--help", "sample --help", "--version", ""] {
        let (code, line) = failed(&command(&folder, arguments).stdout(full()).output().unwrap());
        assert_eq!((code, line.contains("standard output")), (1, true), "{arguments}: {line}");
    }
    assert_eq!(to_full("keys list").code(), Some(0), "there is nothing to list");
    assert_eq!(to_full("health http://127.0.0.1:1/livez").code(), Some(1));
}

#[cfg(unix)]
#[test]
fn a_demo_that_serves_dies_of_the_signal_that_ends_it() {
    use std::os::unix::process::ExitStatusExt;
    let folder = tempdir().unwrap();
    let mut child = Command::new("env")
        .args(["--default-signal", env!("CARGO_BIN_EXE_chladni"), "demo", "--listen", "127.0.0.1:0"])
        .args(["--points", "300", "--bases", "4"])
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.starts_with("Serving on")));
    assert!(Command::new("kill").args(["-s", "INT", &child.id().to_string()]).status().unwrap().success());
    let rest: Vec<String> = lines.collect();
    assert_eq!((child.wait().unwrap().signal(), rest), (Some(2), Vec::new()), "shells stop a loop then");
}
