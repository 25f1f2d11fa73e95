//! Tests of hostile text from outside.

use super::*;

#[test]
fn text_from_outside_is_text_and_nothing_else() {
    let evil = "<script>alert(1)</script>\"' onload=x\u{202e}\0&";
    let sample = Sample::shuttle(true)
        .report("localization/tf_map", 2, evil, &[(evil, evil)])
        .report(&format!("/can/{evil}"), 1, evil, &[(evil, evil)])
        .report(&format!("nobody {evil}"), 2, evil, &[])
        .trouble(evil, TroubleKind::Malformed, 3, evil)
        .pass(3);
    let published = sample.published();
    let mut pages: Vec<String> =
        fragments(&published, Lang::En).into_iter().map(|fragment| fragment.html).collect();
    pages.push(operator_page(&published, &context(Lang::De, Palette::Day)));
    let by_evil = PageContext { user: evil.to_owned(), ..context(Lang::En, Palette::Day) };
    pages
        .extend(crate::developer::tests::pages(&published, &by_evil, evil).into_iter().map(|(_, html)| html));
    let fault = DemoFault { name: "fault", title: text(evil, evil), about: text(evil, evil) };
    pages.push(demo_page(&[fault], &BTreeSet::new(), &context(Lang::En, Palette::Day)));
    pages.push(message_page(404, evil, evil, Home::Fleet, Lang::En, Palette::Day));
    pages.push(login_page(&LoginContext {
        name: evil.to_owned(),
        names: vec![evil.to_owned()],
        failure: Some(LoginFailure::Wrong),
        ..LoginContext::new(Lang::En, Palette::Day, DISPLAY_DPI, false)
    }));
    for html in &pages {
        assert!(!html.contains("<script>") && !html.contains("\"' onload"), "{html}");
    }
    assert!(pages.iter().any(|html| html.contains("&#60;script&#62;alert(1)")));
    assert!(!pages.iter().any(|html| html.contains('\u{202e}') || html.contains('\0')));
}

#[test]
fn endless_text_is_cut() {
    let long = "w".repeat(4000);
    let published =
        Sample::shuttle(true).report("localization/tf_map", 2, &long, &[(&long, &long)]).pass(3).published();
    for fragment in fragments(&published, Lang::En) {
        assert!(!fragment.html.contains(&"w".repeat(300)), "{}", fragment.id);
    }
}
